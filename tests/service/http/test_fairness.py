"""A client that takes all that it can get, and another that comes: by keys, or by addresses without them."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import count

import httpx
import pytest

from core.io import write_mesh
from service import turns
from service.app import DOWNLOADS
from service.auth.keys import digest_of
from service.compute import request_queue as work_module
from service.shapes import service as shapes_service
from service.storage.database import THREADS
from service.turns import Pace
from tests.core.shapes import box
from tests.service.support import Running, assert_problem, query, serving, settings_in, small_file, wait_until
from tests.service.tasks import embed_unless_cube

FIRST, SECOND = "isoshape_first", "isoshape_second"
LENGTH = 3
"""Requests that may wait."""

CUBE = write_mesh(box(1, 1, 1), "off")


@pytest.fixture(scope="module", params=["keys", "addresses"])
def clients(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Running, httpx.Client, httpx.Client]]:
    """A service with one worker, and two clients, of which the first has many addresses if it has a key."""
    by_key = request.param == "keys"
    keys = {"api_keys": tuple(map(digest_of, (FIRST, SECOND)))} if by_key else {}
    settings = settings_in(tmp_path_factory.mktemp("service"), workers=1, queue_length=LENGTH, **keys)
    numbers = count(1)

    def name_address(sent: httpx.Request) -> None:
        number = next(numbers) if by_key else 1
        sent.headers["x-forwarded-for"] = f"192.0.2.{number}"

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FORWARDED_ALLOW_IPS", "127.0.0.1")
        with (
            serving(settings, key=FIRST) as running,
            httpx.Client(base_url=running.client.base_url) as second,
        ):
            running.client.event_hooks = {"request": [name_address]}
            second.headers["x-forwarded-for"] = "192.0.2.1" if by_key else "192.0.2.2"
            second.headers["x-api-key"] = SECOND
            second.timeout = 120
            yield running, running.client, second


def test_the_queue_that_a_client_fills_has_room_for_another(
    clients: tuple[Running, httpx.Client, httpx.Client], monkeypatch: pytest.MonkeyPatch
) -> None:
    running, first, second = clients
    queue = running.container.queue
    with ThreadPoolExecutor(LENGTH + 1) as others, monkeypatch.context() as patch:
        patch.setattr(work_module, "embed_mesh", embed_unless_cube)
        flood = []
        for number in range(LENGTH + 1):
            flood.append(others.submit(query, first, CUBE))
            wait_until(lambda number=number: queue.inside == number + 1, seconds=60)
        assert_problem(query(first, small_file(0)), 503, "busy")
        # The other client has a worker at once, each time anew.
        for number in range(3):
            assert query(second, small_file(number)).status_code == 200
        # The newest of the requests that waited has given way.
        assert_problem(flood[-1].result(), 503, "busy")
        assert not any(each.done() for each in flood[:-1])
        assert queue.inside == LENGTH
        patch.undo()
        (busy,) = [slot for slot in running.container.pool._slots if slot.busy]
        busy.stop_working()
        assert_problem(flood[0].result(), 503, "worker-lost")
        assert [each.result().status_code for each in flood[1:-1]] == [200] * (LENGTH - 1)


def test_a_client_that_occupies_the_threads_leaves_some_to_another(
    clients: tuple[Running, httpx.Client, httpx.Client], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, first, second = clients
    list_page, go_on, begun = shapes_service.list_page, threading.Event(), threading.Semaphore(0)

    def wait_and_list(*arguments: object, **named: object) -> object:
        begun.release()
        assert go_on.wait(60)
        return list_page(*arguments, **named)  # type: ignore[arg-type]

    with ThreadPoolExecutor(60) as others, monkeypatch.context() as patch:
        patch.setattr(shapes_service, "list_page", wait_and_list)
        flood = [others.submit(first.get, "/shapes") for _ in range(60)]
        for _ in range(THREADS):
            assert begun.acquire(timeout=60)
        assert second.get("/version").status_code == 200
        assert_problem(second.get("/shapes/none"), 404, "shape-not-found")
        assert query(second, small_file(0)).status_code == 200
        go_on.set()
        assert [each.result().status_code for each in flood] == [200] * 60


def test_a_client_that_reads_slowly_has_few_files_in_memory(
    clients: tuple[Running, httpx.Client, httpx.Client], monkeypatch: pytest.MonkeyPatch
) -> None:
    running, first, second = clients
    monkeypatch.setattr(turns, "PATIENCE_SECONDS", 60.0)
    large = small_file(9) + b"\n" * 30_000_000
    shapes = [running.store(data, f"{len(data)}.off")["id"] for data in (large, small_file(9))]
    with ThreadPoolExecutor(1) as others, ExitStack() as stack:
        for _ in range(DOWNLOADS):
            answer = stack.enter_context(first.stream("GET", f"/shapes/{shapes[0]}/file"))
            assert answer.status_code == 200
        further = others.submit(first.get, f"/shapes/{shapes[1]}/file")
        downloads = running.container.downloads._clients
        wait_until(lambda: any(places._waiters for places in list(downloads.values())), seconds=30)
        assert second.get(f"/shapes/{shapes[1]}/file").content == small_file(9)
        assert not further.done()
        monkeypatch.setattr(turns, "PATIENCE_SECONDS", 0.01)
        assert_problem(first.get(f"/shapes/{shapes[1]}/file"), 503, "busy")
        stack.close()
        assert further.result().content == small_file(9)


def test_requests_have_a_pace_and_refusals_a_slower_one(
    clients: tuple[Running, httpx.Client, httpx.Client], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, first, second = clients
    waits: list[tuple[int, str]] = []

    async def wait(pace: Pace, client: str) -> None:
        waits.append((round(1 / pace._interval), client))

    monkeypatch.setattr(Pace, "wait", wait)
    for client in (first, second, first):
        assert client.get("/version").status_code == 200
    (first_pace, first_name), (second_pace, second_name), again = waits
    assert again == (first_pace, first_name)
    assert first_pace == second_pace
    assert first_name != second_name
    headers = {"sec-fetch-site": "cross-site", "x-forwarded-for": "192.0.2.77"}
    assert httpx.post(f"{first.base_url}/query", headers=headers).status_code == 403
    (refusal,) = waits[3:]
    assert refusal[0] < first_pace
    assert refusal[1] == "192.0.2.77"
