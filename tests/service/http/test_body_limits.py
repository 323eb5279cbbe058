"""The share of each client in the temporary folder, and the size of JSON."""

import asyncio
import json
import shutil
from typing import Any

import pytest

from service import turns
from service.errors import BusyError, StorageFullError
from service.http.body_limits import FORM_OVERHEAD, ClientQuotas
from service.http.problem_document import FAULTS
from tests.service.http.responsiveness import assert_others_are_served
from tests.service.support import Running, assert_problem

MB = 1_000_000
PIECE = 100_000


class Disk:
    """A temporary folder that clients fill piece by piece."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, size: int, largest: int) -> None:
        self.free = size
        self.quotas = ClientQuotas(10, largest - FORM_OVERHEAD)
        usage = shutil.disk_usage("/")
        monkeypatch.setattr(shutil, "disk_usage", lambda _path: usage._replace(free=self.free))

    def write(self, client: str, size: int) -> int:
        """Write up to `size` bytes, and return how many the client may."""
        for written in range(0, size, PIECE):
            try:
                self.quotas.take(client, PIECE)
            except StorageFullError:
                return written
            self.free -= PIECE
        return size


@pytest.mark.parametrize("largest", [10 * MB, 100 * MB])
def test_two_stalled_bodies_of_a_client_leave_room_for_a_large_one(
    monkeypatch: pytest.MonkeyPatch, largest: int
) -> None:
    disk = Disk(monkeypatch, 30 * MB, largest)
    assert disk.write("stalled", 7_400_000) == 7_400_000
    assert disk.write("stalled", 7_400_000) < 7_400_000
    assert disk.write("other", 9_300_000) == 9_300_000


def test_three_clients_have_room_for_a_large_body_each(monkeypatch: pytest.MonkeyPatch) -> None:
    disk = Disk(monkeypatch, 30 * MB, 9_300_000)
    assert disk.write("first", 30 * MB) >= 9_300_000
    assert disk.write("second", 30 * MB) >= 9_300_000
    assert disk.write("third", 9_300_000) == 9_300_000


def test_a_client_alone_has_all_but_two_large_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    disk = Disk(monkeypatch, 300 * MB, 10 * MB)
    assert disk.write("only", 300 * MB) == 280 * MB


def test_a_further_body_waits_for_an_end_and_not_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    async def run() -> None:
        quotas = ClientQuotas(2, MB)
        places = [await quotas.begin("many") for _ in range(2)]
        further = asyncio.create_task(quotas.begin("many"))
        await quotas.begin("other")
        assert list(quotas._bodies._clients) == ["many"]
        assert not further.done()
        places.pop().release()
        places.append(await further)
        monkeypatch.setattr(turns, "PATIENCE_SECONDS", 0.01)
        with pytest.raises(BusyError):
            await quotas.begin("many")

    asyncio.run(run())


def post(service: Running, body: dict[str, Any]) -> Any:
    return service.client.post(
        "/compare", content=json.dumps(body), headers={"content-type": "application/json"}
    )


def test_json_of_many_unknown_keys_delays_nobody(service: Running) -> None:
    body = {f"k{i}": 0 for i in range(5500)}
    assert len(json.dumps(body)) < 64 * 1024
    problem = assert_problem(post(service, body), 422, "bad-request-fields")
    assert len(problem["errors"]) == FAULTS
    assert_others_are_served(service.client, lambda: post(service, body), at_a_time=2)
    assert_problem(post(service, {f"k{i}": 0 for i in range(80_000)}), 413, "body-too-large")


def test_the_longest_text_of_a_shape_is_taken(service: Running) -> None:
    text = "ж" * 64
    body = {
        "name": "ж" * 255,
        "tags": [text[:60] + f"{i:04d}" for i in range(32)],
        "metadata": {"a": "ж" * 8000},
    }
    assert_problem(service.client.patch("/shapes/none", json=body), 404, "shape-not-found")
    content = json.dumps(body)
    assert "\\u0436" in content
    headers = {"content-type": "application/json"}
    assert_problem(
        service.client.patch("/shapes/none", content=content, headers=headers), 404, "shape-not-found"
    )
