"""The header Idempotency-Key: an upload that is sent again has its first answer, and changes nothing."""

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import select, text

from core.pipeline import Pipeline
from service.auth.keys import digest_of
from service.collection import DEFAULT_COLLECTION
from service.compute.tasks import Embedded
from service.http.idempotency import HEADER, KEPT_TIME, REPLAYED, Claim, Kept, payload_of, read_key
from service.shapes.records import NewShape, StoredShape
from service.shapes.service import answer_of, ingest
from service.storage.tables import IdempotencyKeyRow
from tests.service.engines import on_both, url_of
from tests.service.http.test_disconnects import send as send_and_leave
from tests.service.support import (
    Running,
    assert_problem,
    on_loop,
    serving,
    settings_in,
    small_file,
    wait_until,
)

LONG = '"' + 256 * "x" + '"'
KEY = '"8e03978e-40d5-43e8-bc93-6894a57f9324"'


def send(
    client: httpx.Client,
    data: bytes,
    filename: str = "ball.off",
    *,
    key: str = KEY,
    headers: dict[str, str] | None = None,
    **fields: Any,
) -> httpx.Response:
    """An upload with an Idempotency-Key."""
    sent = {HEADER: key, **(headers or {})}
    return client.post("/shapes", files={"file": (filename, data)}, data=fields, headers=sent)


def total(running: Running) -> int:
    return int(running.client.get("/shapes").json()["total"])


@pytest.fixture(autouse=True)
def no_keys_before(request: pytest.FixtureRequest) -> None:
    """The shared service knows no key of an earlier test."""
    if "service" in request.fixturenames:
        running: Running = request.getfixturevalue("service")
        with running.container.database.write() as session:
            session.execute(text("DELETE FROM idempotency_keys"))


def assert_replayed(answer: httpx.Response, first: httpx.Response) -> None:
    assert answer.headers[REPLAYED] == "true"
    assert REPLAYED not in first.headers
    assert answer.status_code == first.status_code
    assert answer.content == first.content
    for name in ("location", "content-type"):
        assert answer.headers[name] == first.headers[name]


def test_the_first_answer_comes_again_whatever_became_of_the_shape(service: Running) -> None:
    first = send(service.client, small_file(0), tags=["a", "b"], metadata='{"x": 1}')
    assert first.status_code == 201
    shape = first.json()
    assert service.client.get(first.headers["location"]).json() | {"created": True, "changed": []} == shape
    assert_replayed(send(service.client, small_file(0), tags=["a", "b"], metadata='{"x": 1}'), first)
    assert service.client.patch(f"/shapes/{shape['id']}", json={"name": "other"}).status_code == 200
    # Without a key this would be a second record now.
    assert_replayed(send(service.client, small_file(0), tags=["a", "b"], metadata='{"x": 1}'), first)
    assert total(service) == 1
    assert service.client.delete(f"/shapes/{shape['id']}").status_code == 204
    assert_replayed(send(service.client, small_file(0), tags=["a", "b"], metadata='{"x": 1}'), first)
    assert total(service) == 0
    service.store(small_file(0), "ball.off")
    present = send(service.client, small_file(0), key='"second"')
    assert present.status_code == 200
    assert_replayed(send(service.client, small_file(0), key='"second"'), present)


@pytest.mark.parametrize(
    "other",
    [
        {"data": small_file(1)},
        {"filename": "ball.OFF"},
        {"name": "another"},
        {"tags": "b"},
        {"tags": ["a", "a"]},
        {"metadata": "{}"},
    ],
)
def test_another_payload_is_refused(service: Running, other: dict[str, Any]) -> None:
    one: dict[str, Any] = {"data": small_file(0), "tags": "a"}
    first = send(service.client, **one)
    assert first.status_code == 201
    assert_problem(send(service.client, **{**one, **other}), 422, "idempotency-key-reused")
    assert_replayed(send(service.client, **one), first)
    assert total(service) == 1


@pytest.mark.parametrize(
    "value", [*("8e03978e", "", '""', '"a', '"a"b"', '"a", "b"', '"a\\b"', '"ä"', '"a\tb"', LONG)]
)
def test_a_malformed_key_is_refused(service: Running, value: str) -> None:
    answer = service.client.post(
        "/shapes", files={"file": ("a.off", small_file(0))}, headers={HEADER: value.encode()}
    )
    assert_problem(answer, 400, "idempotency-key-malformed")
    twice = [(HEADER, KEY), (HEADER, KEY)]
    answer = service.client.post("/shapes", files={"file": ("a.off", small_file(0))}, headers=twice)
    assert_problem(answer, 400, "idempotency-key-malformed")
    assert total(service) == 0


@pytest.mark.parametrize(
    ("value", "key"),
    [
        ('"a"', "a"),
        ('  "a"  ', "a"),
        ('"a b"', "a b"),
        (r'"a\"b\\c"', r'a"b\c'),
        ('"' + 255 * "x" + '"', 255 * "x"),
    ],
)
def test_a_key_is_a_string_of_rfc_8941(value: str, key: str) -> None:
    assert read_key([value]) == key
    assert read_key([]) is None


def test_an_upload_that_was_not_stored_is_tried_again(service: Running) -> None:
    refused = send(service.client, small_file(0)[:100])
    assert refused.status_code == 422
    again = send(service.client, small_file(0)[:100])
    assert (again.status_code, REPLAYED in again.headers) == (422, False)
    assert send(service.client, small_file(0)).status_code == 201


def test_a_key_whose_first_request_is_at_work_is_refused(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = service.container.queue
    embed = work.embed
    begun, go_on = threading.Event(), threading.Event()

    async def slow(data: bytes, format: str, pipeline: Pipeline) -> Embedded:
        begun.set()
        await asyncio.to_thread(go_on.wait, 60)
        return await embed(data, format, pipeline)

    with monkeypatch.context() as patch, ThreadPoolExecutor(1) as other:
        patch.setattr(work, "embed", slow)
        first = other.submit(send, service.client, small_file(0))
        try:
            assert begun.wait(60)
            assert_problem(send(service.client, small_file(0)), 409, "idempotency-key-in-flight")
        finally:
            go_on.set()
        assert send(service.client, small_file(1), key='"another"').status_code == 201
        assert first.result().status_code == 201
    assert_replayed(send(service.client, small_file(0)), first.result())
    assert total(service) == 2


def test_a_key_is_free_again_when_its_client_goes_away(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = service.container.queue
    begun, ended = threading.Event(), threading.Event()

    async def endless(data: bytes, format: str, pipeline: Pipeline) -> Embedded:
        begun.set()
        try:
            await asyncio.sleep(60)
        finally:
            ended.set()
        raise AssertionError

    with monkeypatch.context() as patch:
        patch.setattr(work, "embed", endless)
        files = {"file": ("ball.off", small_file(0))}
        with send_and_leave(service, "/shapes", files=files, headers={HEADER: KEY}):
            assert begun.wait(60)
        assert ended.wait(30)
    wait_until(lambda: send(service.client, small_file(0)).status_code == 201, seconds=30)


@on_both
def test_many_at_a_time_have_one_answer(service: Running) -> None:
    with ThreadPoolExecutor(8) as clients:
        answers = list(clients.map(lambda _: send(service.client, small_file(0)), range(16)))
    assert {answer.status_code for answer in answers} <= {201, 409}
    done = [answer for answer in answers if answer.status_code == 201]
    assert len({answer.content for answer in done}) == 1
    assert sum(REPLAYED not in answer.headers for answer in done) == 1
    assert total(service) == 1


@on_both
def test_answers_outlive_the_service_until_they_expire(service: Running) -> None:
    url = url_of(service.container.database)
    settings = service.container.settings.model_copy(update={"database_url": url, "workers": 1})
    with serving(settings) as ended:
        first = send(ended.client, small_file(0))
        send(ended.client, small_file(1), key='"second"')
        assert total(ended) == 2
    # By another service on its archive.
    assert_replayed(send(service.client, small_file(0)), first)
    assert_problem(send(service.client, small_file(2)), 422, "idempotency-key-reused")
    with service.container.database.read() as session:
        expiry = select(IdempotencyKeyRow.expires_at).where(IdempotencyKeyRow.key.startswith("8e"))
        left = session.scalars(expiry).one() - datetime.now(UTC)
    assert KEPT_TIME - timedelta(minutes=12) < left <= KEPT_TIME
    with service.container.database.write() as session:
        session.execute(text("UPDATE idempotency_keys SET expires_at = '2001-01-01 00:00:00.000000'"))
    anew = send(service.client, small_file(2))
    assert (anew.status_code, REPLAYED in anew.headers) == (201, False)
    assert_replayed(send(service.client, small_file(2)), anew)
    with service.container.database.read() as session:
        kept = session.execute(text("SELECT key FROM idempotency_keys")).scalars().all()
    assert kept == [KEY.strip('"')]


def test_keys_belong_to_the_api_key_that_they_come_with(tmp_path: Path) -> None:
    keys = ("isoshape_one", "isoshape_two")
    settings = settings_in(tmp_path, workers=1, api_keys=tuple(digest_of(key) for key in keys))
    with serving(settings, key=keys[0]) as running:
        bearer = [{"authorization": f"Bearer {key}"} for key in keys]
        first = send(running.client, small_file(0), headers=bearer[0])
        other = send(running.client, small_file(1), headers=bearer[1])
        assert (first.status_code, other.status_code) == (201, 201)
        assert_replayed(send(running.client, small_file(0), headers=bearer[0]), first)
        assert_replayed(send(running.client, small_file(1), headers=bearer[1]), other)


@on_both
def test_an_answer_that_another_process_gave_meanwhile_is_the_answer(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    new = NewShape(small_file(0), "off", DEFAULT_COLLECTION.number, "ball.off", tags=(), metadata={})
    claim = Claim(
        DEFAULT_COLLECTION.number,
        "",
        "a key",
        payload_of(new.sha256, "ball.off", {}),
        datetime.now(UTC) + timedelta(hours=1),
    )
    work = service.container.queue
    embed = work.embed
    answers: list[list[StoredShape] | Kept] = []

    async def late(data: bytes, format: str, pipeline: Pipeline) -> Embedded:
        with monkeypatch.context() as patch:
            patch.setattr(work, "embed", embed)
            answers.append(await ingest(service.container, new, claim))
        return await embed(data, format, pipeline)

    with monkeypatch.context() as patch:
        patch.setattr(work, "embed", late)
        answers.append(on_loop(service, ingest(service.container, new, claim)))
    stored, kept = answers
    assert isinstance(stored, list)
    assert [shape.created for shape in stored] == [True]
    assert kept == answer_of(stored, split=False)
    assert total(service) == 1


def test_a_payload_is_the_same_however_its_form_was_written(service: Running) -> None:
    first = send(service.client, small_file(0), name="x", tags=["a", "b"])
    assert first.status_code == 201
    boundary = "another-boundary"
    parts = [
        'Content-Disposition: form-data; name="tags"\r\n\r\na',
        'Content-Disposition: form-data; name="tags"\r\n\r\nb',
        'Content-Disposition: form-data; name="file"; filename="ball.off"\r\n\r\n' + small_file(0).decode(),
        'Content-Disposition: form-data; name="name"\r\n\r\nx',
    ]
    body = "".join(f"--{boundary}\r\n{part}\r\n" for part in parts) + f"--{boundary}--\r\n"
    headers = {HEADER: KEY, "content-type": f"multipart/form-data; boundary={boundary}"}
    assert_replayed(service.client.post("/shapes", content=body.encode(), headers=headers), first)
