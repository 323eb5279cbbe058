"""Every hostile file over HTTP. The captured output (`-rP`) is the table of docs/hostile.md."""

import time
from collections import Counter
from typing import NamedTuple

import httpx
import numpy as np

from service.http.problem_document import MEDIA_TYPE, TYPE_PREFIX
from tests.core.io.files import PLAIN
from tests.service.support import small_file, upload, wait_until
from tests.soak.hostile.conftest import LIMIT_SECONDS, Served
from tests.soak.hostile.corpus import CORPUS, ROWS, Hostile
from tests.soak.memory import Watch, memory, proportional

PEAK = 4096.0
# MiB of the service and of its workers in one round.
GROWTH = (16.0, 64.0)


def answer(client: httpx.Client, filename: str, data: bytes) -> str:
    """The answer to a file, which is deleted if it was stored: its status, and the kind of problem."""
    try:
        response = client.post("/shapes", files={"file": (filename, data)})
    except httpx.TimeoutException:
        return "none in time"
    if response.status_code == 201:
        assert client.delete(response.headers["location"]).status_code == 204
        return "201"
    assert response.headers["content-type"] == MEDIA_TYPE
    return f"{response.status_code} {response.json()['type'].removeprefix(TYPE_PREFIX)}"


class Outcome(NamedTuple):
    """The answer to a file, the seconds from sending to it, and MiB of all processes meanwhile."""

    case: Hostile
    answer: str
    seconds: float
    peak: float


def outcome(served: Served, case: Hostile) -> Outcome:
    data = case.make()
    with Watch(served.pid, every_seconds=0.1, measure=proportional) as watch:
        start = time.perf_counter()
        given = answer(served.client, case.filename, data)
        seconds = time.perf_counter() - start
    return Outcome(case, given, seconds, max(service + workers for _, service, workers in watch.samples))


def table(outcomes: list[Outcome]) -> str:
    rows = ["| input | files | answer | worst seconds | peak memory, MiB |", "|---|---:|---|---:|---:|"]
    for key, title in ROWS.items():
        of_row = [each for each in outcomes if each.case.row == key]
        answers = Counter(each.answer for each in of_row).most_common()
        counted = [f"{name} ({count})" for name, count in answers]
        given = ", ".join(counted) if len(answers) > 1 else answers[0][0]
        seconds, peak = (max(values) for values in zip(*(each[2:] for each in of_row), strict=True))
        rows.append(f"| {title} | {len(of_row)} | {given} | {seconds:.2f} | {peak:.0f} |")
    return "\n".join(rows)


def all_idle(client: httpx.Client) -> bool:
    """Whether all workers and readers of the service are idle, and none starts."""
    metrics = client.get("/metrics").text
    return all(
        f'isoshape_{processes}{{state="{state}"}} 0.0' in metrics
        for processes in ("workers", "readers")
        for state in ("busy", "starting")
    )


def test_every_row_and_format_has_files_of_other_names_and_the_same_each_time() -> None:
    assert {case.row for case in CORPUS} == set(ROWS)
    assert len({case.filename for case in CORPUS}) == len(CORPUS) >= 480
    endings = Counter(case.filename.rpartition(".")[2] for case in CORPUS)
    least = {**dict.fromkeys([*PLAIN, "3mf"], 20), "step": 8, "zip": 1, "zae": 1, "dae": 1, "gz": 1}
    assert all(endings[ending] >= count for ending, count in least.items())
    for case in CORPUS:
        assert case.slow or case.make() == case.make(), case.filename


def test_each_is_answered_as_it_must_be_within_limits(served: Served) -> None:
    outcomes = [outcome(served, case) for case in CORPUS]
    print(table(outcomes))
    assert [each for each in outcomes if each.answer != each.case.answer] == []
    assert max(each.seconds for each in outcomes) < LIMIT_SECONDS
    assert max(each.peak for each in outcomes) < PEAK
    assert served.client.get("/shapes").json()["total"] == 0
    assert upload(served.client, small_file(0), "after.off").status_code == 201
    # Nothing was written by files whose names are paths, or that name others.
    files = {path.name for path in served.folder.rglob("*")}
    ends = ("", "-journal", "-wal", "-shm", "-lock", "-serving", "-reserve", "-jobs")
    assert files <= {f"archive.sqlite3{end}" for end in ends} | {"log.txt"}, files


def test_memory_stays_flat(served: Served) -> None:
    """Measured when no process starts: a reader that is being replaced counts twice or not at all."""
    after = []
    for _ in range(3):
        for case in CORPUS:
            if not case.slow:
                answer(served.client, case.filename, case.make())
        wait_until(lambda: all_idle(served.client), seconds=60)
        after.append(memory(served.pid))
    print("MiB of the service, and of its workers and readers, after each round:", np.round(after).tolist())
    # A leak shows in every round; the file that makes a process large may be another's in the next.
    assert (np.diff(after, axis=0).min(axis=0) < GROWTH).all(), after
