"""Webhooks: a message tells all that is new, its signature holds, and it waits for a receiver that fails."""

import asyncio
import base64
import json
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any

import httpx
import pytest
from sqlalchemy import delete, select, update
from standardwebhooks.webhooks import Webhook

from service.storage.tables import WebhookRow
from service.webhooks import repository
from service.webhooks.repository import Message
from service.webhooks.sender import Sender, headers_of
from tests.service.engines import on_both
from tests.service.jobs.support import ended, pack, send
from tests.service.support import Running, on_loop, small_file

pytestmark = on_both

SECRET = f"whsec_{base64.b64encode(bytes(range(32))).decode()}"


class Receiver:
    """A server on loopback that keeps what it is sent, and answers with the first of `statuses`, or 204."""

    def __init__(self) -> None:
        self.sent: list[tuple[dict[str, str], bytes]] = []
        self.statuses: list[int] = []
        receiver = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["content-length"]))
                receiver.sent.append(({k.lower(): v for k, v in self.headers.items()}, body))
                self.send_response(receiver.statuses.pop(0) if receiver.statuses else 204)
                self.send_header("location", "/elsewhere")
                self.end_headers()

            def log_message(self, *_: object) -> None: ...

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.address = f"http://127.0.0.1:{self.server.server_port}/hook?token=1"

    def messages(self) -> dict[str, list[dict[str, Any]]]:
        """What was told since the last call, by kind; each message has a good signature."""
        told = {}
        for headers, body in self.sent:
            message = Webhook(SECRET).verify(body, headers)
            assert message["type"] not in told
            told[message["type"]] = message["data"]
        self.sent.clear()
        return told


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    receiver = Receiver()
    thread = Thread(target=receiver.server.serve_forever, kwargs={"poll_interval": 0.05})
    thread.start()
    yield receiver
    receiver.server.shutdown()
    thread.join()
    receiver.server.server_close()


class Telling:
    """A sender of a running service that looks when it is told to."""

    def __init__(self, running: Running, address: str) -> None:
        values = {"webhook_url": address, "webhook_secret": SECRET}
        settings = running.container.settings.model_copy(update=values)
        self.running, self.client = running, httpx.AsyncClient()
        self.container = replace(running.container, settings=settings)
        with self.container.database.write() as session:
            session.execute(delete(WebhookRow))
            repository.begin(session)
        self.sender = Sender(self.container, self.client)

    def look(self) -> None:
        on_loop(self.running, self.sender.look())

    def rows(self) -> dict[str, WebhookRow]:
        with self.container.database.read() as session:
            return {row.kind: row for row in session.scalars(select(WebhookRow))}


@pytest.fixture
def telling(service: Running, receiver: Receiver) -> Iterator[Telling]:
    telling = Telling(service, receiver.address)
    yield telling
    on_loop(service, telling.client.aclose())


def test_a_message_tells_all_that_is_new(telling: Telling, receiver: Receiver) -> None:
    client, store = telling.running.client, telling.running.store
    telling.look()
    assert receiver.sent == []
    first, second, gone = (store(small_file(i), name=f"{i}.off") for i in range(3))
    client.delete(f"/shapes/{gone['id']}")
    telling.look()
    stored = [
        {"collection": "default", "id": shape["id"], "name": shape["name"]} for shape in (first, second)
    ]
    assert receiver.messages() == {"shapes.stored": stored}

    twin = store(small_file(0), name="twin.off")
    assert len(client.get("/duplicates").json()["groups"]) == 1
    job = ended(client, send(client, pack({"a.off": small_file(3), "broken.off": b"x"})).json()["id"])
    telling.look()
    told = receiver.messages()
    assert [shape["name"] for shape in told.pop("shapes.stored")] == ["twin.off", "a.off"]
    pair = [{"id": shape["id"], "name": shape["name"]} for shape in (first, twin)]
    assert told == {
        "duplicates.found": [{"collection": "default", "shapes": pair, "variant": False}],
        "jobs.ended": [{"collection": "default", "id": job["id"], "archive": "meshes.zip", "state": "done"}],
    }
    client.get("/duplicates")
    telling.look()
    assert receiver.messages() == {}


def test_a_message_that_fails_is_tried_again_and_what_comes_meanwhile_follows(
    telling: Telling, receiver: Receiver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An answer that leads elsewhere is a failure."""
    monkeypatch.setattr(repository, "FIRST_PAUSE", timedelta(0))
    receiver.statuses = [500, 302]
    telling.running.store(small_file(1), name="a.off")
    telling.look()
    telling.running.store(small_file(2), name="b.off")
    for _ in range(2):
        telling.look()
    assert len(receiver.sent) == 3
    ((one, body), *others) = receiver.sent
    assert all((headers["webhook-id"], each) == (one["webhook-id"], body) for headers, each in others)
    assert [shape["name"] for shape in json.loads(body)["data"]] == ["a.off"]
    receiver.sent.clear()
    telling.look()
    assert [shape["name"] for shape in receiver.messages()["shapes.stored"]] == ["b.off"]


def test_pauses_grow_and_have_an_end(
    telling: Telling, receiver: Receiver, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(repository, "ATTEMPTS", 8)
    monkeypatch.setattr("service.webhooks.sender.ATTEMPTS", 8)
    receiver.statuses = [503] * 8
    telling.running.store(small_file(1), name="a.off")
    pauses = []
    for _ in range(8):
        telling.look()
        due = telling.rows()["shapes.stored"].due_at
        pauses.append(None if due is None else (due - datetime.now(UTC)).total_seconds())
        telling.look()
        with telling.container.database.write() as session:
            session.execute(
                update(WebhookRow).where(WebhookRow.body.is_not(None)).values(due_at=datetime.now(UTC))
            )
    assert pauses.pop() is None
    assert pauses == pytest.approx([20, 80, 320, 1280, 3600, 3600, 3600], abs=3)
    assert len(receiver.sent) == 8
    receiver.sent.clear()
    telling.running.store(small_file(2), name="b.off")
    telling.look()
    assert [shape["name"] for shape in receiver.messages()["shapes.stored"]] == ["b.off"]


def test_two_services_that_share_an_archive_tell_nothing_twice(telling: Telling, receiver: Receiver) -> None:
    telling.running.store(small_file(1), name="a.off")
    senders = [Sender(telling.container, telling.client) for _ in range(2)]

    async def look() -> None:
        await asyncio.gather(*(sender.look() for sender in senders))

    on_loop(telling.running, look())
    assert len(receiver.messages()["shapes.stored"]) == 1
    on_loop(telling.running, look())
    assert receiver.sent == []


def test_a_clock_that_is_set_back_delays_no_message(telling: Telling, receiver: Receiver) -> None:
    receiver.statuses = [503]
    telling.running.store(small_file(1), name="a.off")
    telling.look()
    receiver.sent.clear()
    with telling.container.database.write() as session:
        later = datetime.now(UTC) + timedelta(days=365)
        session.execute(update(WebhookRow).where(WebhookRow.body.is_not(None)).values(due_at=later))
    telling.look()
    assert len(receiver.messages()["shapes.stored"]) == 1


def test_a_changed_message_has_another_signature() -> None:
    message, now = (
        Message("shapes.stored", "msg_1", '{"type": "shapes.stored"}', 1),
        int(datetime.now().timestamp()),
    )
    headers = headers_of(message, bytes(range(32)), now)
    Webhook(SECRET).verify(message.body, headers)
    for changed in (
        headers_of(replace(message, body="{}"), bytes(range(32)), now),
        headers_of(message, bytes(32), now),
        headers_of(message, bytes(range(32)), now - 3600),
    ):
        with pytest.raises(Exception, match=r"[Ss]ignature|timestamp"):
            Webhook(SECRET).verify(message.body, changed)
