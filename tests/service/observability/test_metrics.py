"""The metrics: what they count, and that all of them are documented."""

import os
import re
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from service.compute import request_queue as work_module
from service.compute.pool import LocalPool
from service.errors import PROBLEMS
from service.observability.metrics import PREFIX
from tests.service.support import Running, module_service, query, small_file, upload, wait_until
from tests.service.tasks import nap_instead

DOCUMENT = Path(__file__).parents[3] / "docs" / "operating.md"

Sample = tuple[str, frozenset[tuple[str, str]]]


running = module_service(queue_length=0, shortlist_from=2, shortlist_length=1)
"""A service of its own, whose counts nobody else changes."""


def values(running: Running) -> dict[Sample, float]:
    """Every sample, by name and labels."""
    answer = running.client.get("/metrics")
    assert answer.status_code == 200
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in text_string_to_metric_families(answer.text)
        for sample in family.samples
    }


def value(running: Running, name: str, **labels: str) -> float:
    return values(running).get((PREFIX + name, frozenset(labels.items())), 0.0)


def test_every_metric_is_documented_with_its_type_and_labels(running: Running) -> None:
    registry = running.container.metrics.registry
    live = {}
    for metric, names in registry._collector_to_names.items():
        if any(name.startswith(PREFIX) for name in names):
            live[metric._name] = (metric._type, list(metric._labelnames))  # type: ignore[attr-defined]
    rows = re.findall(r"^\| `(isoshape_\w+)` \| (\w+) \| ([^|]*)\| [^|]+ \|$", DOCUMENT.read_text(), re.M)
    assert live == {name: (kind, re.findall(r"`(\w+)`", labels)) for name, kind, labels in rows}
    assert len(live) > 10


def test_the_format_is_that_of_prometheus(running: Running) -> None:
    plain = running.client.get("/metrics")
    assert plain.headers["content-type"].startswith("text/plain; version=")
    names = {family.name for family in text_string_to_metric_families(plain.text)}
    assert {"isoshape_requests", "isoshape_workers", "process_resident_memory_bytes"} <= names
    modern = running.client.get("/metrics", headers={"accept": "application/openmetrics-text; version=1.0.0"})
    assert modern.headers["content-type"].startswith("application/openmetrics-text")
    assert modern.text.endswith("# EOF\n")


def test_requests_are_counted_by_route_and_not_by_address(running: Running) -> None:
    before = values(running)
    for number in range(3):
        running.client.get(f"/shapes/none-{number}")
        running.client.get(f"/nowhere/{number}")
    running.client.request("BREW", "/shapes")
    running.client.get("/healthz")

    def more() -> dict[Sample, float]:
        return {
            sample: count - before.get(sample, 0.0)
            for sample, count in values(running).items()
            if sample[0] == "isoshape_requests_total" and count != before.get(sample, 0.0)
        }

    def sample(method: str, route: str, status: int) -> Sample:
        labels = {"method": method, "route": route, "status": str(status)}
        return ("isoshape_requests_total", frozenset(labels.items()))

    wait_until(lambda: sample("GET", "/healthz", 200) in more(), seconds=5)
    counted = more()
    assert counted.pop(sample("GET", "/metrics", 200)) > 0
    assert counted == {
        sample("GET", "/shapes/{shape_id}", 404): 3,
        sample("GET", "other", 404): 3,
        sample("other", "/shapes", 405): 1,
        sample("GET", "/healthz", 200): 1,
    }
    assert value(running, "requests_in_progress") == 1  # this one
    assert value(running, "problems_total", kind="shape-not-found") >= 3
    assert value(running, "request_seconds_count", method="GET", route="/shapes/{shape_id}") >= 3


def test_stages_of_an_upload_a_query_and_a_comparison(running: Running) -> None:
    before = values(running)

    def more(name: str, **labels: str) -> float:
        key = (PREFIX + name, frozenset(labels.items()))
        return values(running).get(key, 0.0) - before.get(key, 0.0)

    first, second = (running.store(small_file(number)) for number in range(2))
    # The file is known under another name already: it is stored, and not embedded again.
    running.store(small_file(0), name="again")
    # The nearest by eigenvalues and the nearest by views.
    assert query(running.client, small_file(2)).json()["compared"] == 2
    pair = {"first": first["id"], "second": second["id"]}
    assert running.client.post("/compare", json=pair).status_code == 200
    stages = {
        "upload": {"read": 2, "embed": 2, "store": 3},
        "query": {
            "read": 1,
            "embed": 1,
            "shortlist": 1,
            "compare": 1,
            "results": 1,
            "likeness": 1,
            "instances": 1,
        },
        "compare": {"read": 1, "compare": 1, "likeness": 1},
    }
    for operation, counts in stages.items():
        for stage, count in counts.items():
            assert more("stage_seconds_count", operation=operation, stage=stage) == count
    assert more("stage_seconds_sum", operation="upload", stage="embed") > 0
    assert (more("query_compared_count"), more("query_compared_sum")) == (1, 2)
    assert more("queries_shortlisted_total") == 1
    assert more("database_seconds_count", session="write") == 3
    assert more("database_seconds_count", session="read") >= 5
    assert value(running, "indexed_shapes") == 3
    # Processes that are started ahead read too.
    wait_until(lambda: value(running, "database_sessions") == 0, seconds=10)


def test_queue_and_workers(running: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    # Work in the background may have started a second process.
    wait_until(lambda: value(running, "workers", state="idle") >= 1, seconds=60)
    assert (value(running, "queue_requests"), value(running, "queue_room")) == (0, 1)
    died = value(running, "worker_replacements_total", cause="died")
    busy = value(running, "problems_total", kind="busy")
    pool, killed = running.container.pool, list[int]()
    assert isinstance(pool, LocalPool)

    def kill() -> bool:
        if value(running, "workers", state="busy") == 1:
            assert value(running, "queue_requests") == 1
            assert upload(running.client, small_file(6), "late.off").status_code == 503
            killed.extend(slot.pid for slot in pool._slots if slot.busy and slot.pid is not None)
            os.kill(killed[0], signal.SIGKILL)
        return bool(killed)

    with monkeypatch.context() as patch, ThreadPoolExecutor(1) as other:
        patch.setattr(work_module, "embed_mesh", nap_instead)
        sent = other.submit(upload, running.client, small_file(5), "killed.off")
        wait_until(kill, seconds=60)
        assert sent.result().status_code == 503
    assert value(running, "worker_replacements_total", cause="died") == died + 1
    wait_until(lambda: value(running, "problems_total", kind="busy") == busy + 1, seconds=5)
    wait_until(lambda: value(running, "queue_requests") == 0, seconds=5)


def test_a_database_that_fails_is_counted(running: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    database = running.container.database
    monkeypatch.setattr(database, "_lock_seconds", 0.05)
    before = value(running, "database_failures_total", kind="storage-unavailable")
    with database.write():
        wait_until(lambda: value(running, "database_sessions") == 1, seconds=10)
        assert running.client.delete("/shapes/x").status_code == 503
    assert value(running, "database_failures_total", kind="storage-unavailable") == before + 1


def test_kinds_of_problems_are_those_of_the_service(running: Running) -> None:
    kinds = {
        dict(labels).get("kind") for name, labels in values(running) if name == "isoshape_problems_total"
    }
    assert kinds
    assert kinds <= set(PROBLEMS)
