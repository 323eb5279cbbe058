"""Mixed load for `MINUTES`, 5 at least: what is answered, and whether memory grows."""

import os
import random
import threading
import time
import uuid
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from core.gallery import CLASSES, make_shape
from core.io import write_mesh
from service.storage.checking import check
from tests.service.processes import server
from tests.service.support import small_file, wait_until
from tests.soak.memory import Growth, Watch, growth

MINUTES = max(5.0, float(os.environ.get("MINUTES") or 5))
CLIENTS, WORKERS = 8, 2
KEPT = 20
"""Shapes that each client keeps; beyond, it deletes."""
WARM_UP, JUDGED = 2_000, MINUTES - 2.0
"""Requests after which workers have met every kind of task, and pools and caches are full; and the minutes
after these in which memory may not grow. A busy machine needs longer for the former."""
MOST_SLOPE, MOST_GROWTH = 1.0, 15.0
"""MiB a minute, and that slope over the judged part of 20 minutes: in five minutes caches still fill, and the
slope alone says little."""


class Client(threading.Thread):
    """Keeps some shapes, and asks about them until the end."""

    def __init__(self, url: str, over: threading.Event) -> None:
        super().__init__()
        self._url = url
        self._over = over
        self._draw = random.Random()
        self._mine: list[str] = []
        self.seconds: dict[str, list[float]] = defaultdict(list)
        self.statuses: dict[str, Counter[int]] = defaultdict(Counter)
        self.broken: list[str] = []
        self.answers = 0

    def run(self) -> None:
        tasks, weights = zip(*TASKS, strict=True)
        with httpx.Client(base_url=self._url, timeout=120) as self._http:
            while not self._over.is_set():
                self._draw.choices(tasks, weights)[0](self)
                time.sleep(self._draw.uniform(0.0, 0.2))

    def send(self, name: str, method: str, path: str, **body: Any) -> httpx.Response | None:
        """Send a request, and note its answer; whoever is turned away waits as told."""
        start = time.perf_counter()
        try:
            answer = self._http.request(method, path, **body)
        except httpx.TransportError as error:
            self.broken.append(f"{name}: {error!r}")
            return None
        self.seconds[name].append(time.perf_counter() - start)
        self.statuses[name][answer.status_code] += 1
        self.answers += 1
        if answer.status_code == 503 and answer.json()["type"] == "urn:isoshape:problem:busy":
            time.sleep(float(answer.headers["retry-after"]))
        elif answer.status_code >= 500:
            self.broken.append(f"{name}: {answer.status_code} {answer.text[:200]}")
        return answer

    def _file(self) -> dict[str, tuple[str, bytes]]:
        return {"file": self._draw.choice(FILES)}

    def _any(self) -> str:
        return self._draw.choice(self._mine or ["none"])

    def upload(self) -> None:
        fields = {"name": str(uuid.uuid4()), "tags": "load"}
        answer = self.send("upload", "POST", "/shapes", files=self._file(), data=fields)
        if answer is not None and answer.status_code == 201:
            self._mine.append(answer.json()["id"])
        if len(self._mine) > KEPT:
            shape = self._mine.pop(self._draw.randrange(len(self._mine)))
            self.send("delete", "DELETE", f"/shapes/{shape}")

    def query_by_file(self) -> None:
        self.send("query by file", "POST", "/query", files=self._file())

    def query_by_id(self) -> None:
        self.send("query by id", "POST", "/query", json={"shape_id": self._any()})

    def compare(self) -> None:
        self.send("compare", "POST", "/compare", json={"first": self._any(), "second": self._any()})

    def page(self) -> None:
        self.send("list", "GET", "/shapes?limit=50")

    def look(self) -> None:
        for part in ("", "/file", "/embedding"):
            self.send(f"shape{part}", "GET", f"/shapes/{self._any()}{part}")

    def change(self) -> None:
        body = {"metadata": {"n": self._draw.random()}}
        self.send("change", "PATCH", f"/shapes/{self._any()}", json=body)

    def bad_upload(self) -> None:
        data = self._draw.randbytes(self._draw.randrange(2000))
        self.send("bad upload", "POST", "/shapes", files={"file": ("bad.stl", data)})

    def probe(self) -> None:
        for path in ("/healthz", "/readyz", "/metrics", "/nothing"):
            self.send(path, "GET", path)


TASKS: list[tuple[Callable[[Client], None], int]] = [
    *((Client.upload, 6), (Client.query_by_file, 4), (Client.query_by_id, 4), (Client.compare, 2)),
    *((Client.page, 3), (Client.look, 3), (Client.change, 1), (Client.bad_upload, 1), (Client.probe, 1)),
]
FILES = [
    *((f"{number}.off", small_file(number)) for number in range(60)),
    *((f"{label}.off", write_mesh(make_shape(label, 0), "off")) for label in CLASSES),
]


def table(clients: list[Client], memory: dict[str, Growth]) -> str:
    """The answers to the requests, and the memory of the service and its largest worker."""
    lines = ["| request | answers | median ms | 95 % ms |", "|---|---|---:|---:|"]
    for name in sorted({name for client in clients for name in client.statuses}):
        statuses = sum((client.statuses[name] for client in clients), Counter())
        seconds = [each for client in clients for each in client.seconds[name]]
        median, most = 1000 * np.quantile(seconds, [0.5, 0.95])
        lines.append(f"| {name} | {dict(sorted(statuses.items()))} | {median:.0f} | {most:.0f} |")
    return "\n".join([*lines, *(f"{name}, MiB: {growth}" for name, growth in memory.items())])


def grows(growth: Growth) -> bool:
    """Whether memory grows faster than `MOST_SLOPE`, and by more than `MOST_GROWTH` in all."""
    return growth.slope > MOST_SLOPE and growth.last - growth.first > MOST_GROWTH


def test_under_mixed_load_all_is_answered_and_memory_does_not_grow(tmp_path: Path) -> None:
    # A short queue, so that back-pressure is part of the load.
    with server(tmp_path, ISOSHAPE_WORKERS=str(WORKERS), ISOSHAPE_QUEUE_LENGTH="4") as (process, client):
        over = threading.Event()
        clients = [Client(str(client.base_url), over) for _ in range(CLIENTS)]
        # The largest worker: one that starts when background work meets requests is no growth.
        with Watch(process.pid, every_seconds=2.0, summary=max) as watch:
            for each in clients:
                each.start()
            wait_until(lambda: sum(each.answers for each in clients) >= WARM_UP, seconds=1_800)
            warm = len(watch.samples)
            time.sleep(60.0 * JUDGED)
            over.set()
            for each in clients:
                each.join()
        stored = client.get("/shapes").json()["total"]
    samples = np.array(watch.samples[warm:])
    memory = {
        name: growth(samples[:, 0], samples[:, column])
        for column, name in enumerate(("service", "largest worker"), start=1)
    }
    print(
        f"{MINUTES:g} minutes, {CLIENTS} clients, {stored} shapes at the end",
        table(clients, memory),
        sep="\n",
    )
    assert [fault for client in clients for fault in client.broken] == []
    assert check(tmp_path / "archive.sqlite3", lock_seconds=10).faults == []
    assert stored > 0
    assert not [name for name, measured in memory.items() if grows(measured)]


@pytest.mark.parametrize("slope", [0.0, 0.5, 3.0, -2.0])
def test_a_straight_line_has_its_slope_and_noise_does_not_change_it_much(slope: float) -> None:
    seconds = np.arange(0.0, 1200.0, 2.0)
    line = 500 + slope * seconds / 60
    assert growth(seconds, line).slope == pytest.approx(slope, abs=1e-9)
    noisy = growth(seconds, line + np.random.default_rng(0).normal(scale=5, size=len(seconds)))
    assert noisy.slope == pytest.approx(slope, abs=0.1)
    assert noisy.last - noisy.first == pytest.approx(slope * 18, abs=3)
    assert grows(noisy) == (slope > 1)


@pytest.mark.parametrize(("slope", "wrong"), [(4.0, False), (12.0, True)])
def test_a_short_run_is_judged_by_the_growth_in_all(slope: float, wrong: bool) -> None:
    seconds = np.arange(45.0, 180.0, 2.0)
    assert grows(growth(seconds, 300 + slope * seconds / 60)) == wrong
