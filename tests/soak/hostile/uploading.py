"""Uploads of hostile files, and the table of their answers."""

import time
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import httpx

from service.http.problem_document import MEDIA_TYPE, TYPE_PREFIX
from tests.service.support import wait_until
from tests.soak.hostile.case import ROWS, Hostile
from tests.soak.hostile.serving import Memory, Peak, memory


@dataclass(frozen=True)
class Outcome:
    """The outcome of one file.

    Attributes
    ----------
    case : Hostile
    status, kind : int, str
        The answer; 0 where there was none within the limit of time.
    seconds : float
        From sending to the answer.
    peak : float
        MiB that the service and its workers held at most meanwhile.
    """

    case: Hostile
    status: int
    kind: str
    seconds: float
    peak: float

    @property
    def right(self) -> bool:
        """Whether the answer is the one that the file must get."""
        return (self.status, self.kind) == (self.case.status, self.case.kind)


def upload_each(pid: int, client: httpx.Client, cases: Iterable[Hostile]) -> list[Outcome]:
    """Upload the files one after another to the service of a process id; what it stores is deleted."""
    outcomes = []
    for case in cases:
        data = case.make()
        with Peak(pid) as peak:
            start = time.perf_counter()
            status, kind = answer(client, case.filename, data)
            seconds = time.perf_counter() - start
        outcomes.append(Outcome(case, status, kind, seconds, peak.mib))
    return outcomes


def answer(client: httpx.Client, filename: str, data: bytes) -> tuple[int, str]:
    """The status of an upload, and the kind of problem; (0, "no-answer") without one."""
    try:
        response = client.post("/shapes", files={"file": (filename, data)})
    except httpx.TimeoutException:
        return 0, "no-answer"
    if response.status_code == 201:
        assert client.delete(response.headers["location"]).status_code == 204
        return 201, ""
    assert response.headers["content-type"] == MEDIA_TYPE
    return response.status_code, response.json()["type"].removeprefix(TYPE_PREFIX)


def memory_after(pid: int, client: httpx.Client, cases: Iterable[Hostile], rounds: int) -> list[Memory]:
    """The resources of the service after each of some rounds of all the files.

    They are measured when no process starts: a reader that is being replaced counts twice or not at all.
    """
    cases = list(cases)
    after = []
    for _ in range(rounds):
        for case in cases:
            answer(client, case.filename, case.make())
        wait_until(lambda: _all_started(client), seconds=60)
        after.append(memory(pid))
    return after


def _all_started(client: httpx.Client) -> bool:
    """Whether all workers and readers of the service are idle, and none starts."""
    metrics = client.get("/metrics").text
    return all(
        f'isoshape_{processes}{{state="{state}"}} {count}' in metrics
        for processes in ("workers", "readers")
        for state, count in (("idle", "2.0"), ("busy", "0.0"), ("starting", "0.0"))
    )


def table(outcomes: list[Outcome], held: Mapping[str, Memory]) -> str:
    """Return the table of the answers, a line of totals, and the memory of the service by moment."""
    rows = ["| input | files | answer | worst seconds | peak memory, MiB |", "|---|---:|---|---:|---:|"]
    for key, title in ROWS.items():
        of_row = [outcome for outcome in outcomes if outcome.case.row == key]
        seconds, peak = max(outcome.seconds for outcome in of_row), max(outcome.peak for outcome in of_row)
        rows.append(f"| {title} | {len(of_row)} | {_answers(of_row)} | {seconds:.2f} | {peak:.0f} |")
    wrong = [outcome for outcome in outcomes if not outcome.right]
    failed = sum(outcome.status >= 500 for outcome in outcomes)
    silent = sum(outcome.status == 0 for outcome in outcomes)
    lines = [
        *rows,
        "",
        f"{len(outcomes)} files: {len(wrong)} answered otherwise than they must be, {failed} answered with "
        f"5xx, {silent} not answered in time.",
        *(f"* {_wrong(outcome)}" for outcome in wrong),
        "",
        "| memory, MiB | service | its workers |",
        "|---|---:|---:|",
        *(f"| {moment} | {memory.service:.0f} | {memory.workers:.0f} |" for moment, memory in held.items()),
    ]
    return "\n".join(lines)


def _answers(outcomes: list[Outcome]) -> str:
    """The answers, the most frequent first."""
    counted = Counter((outcome.status, outcome.kind) for outcome in outcomes)
    return ", ".join(
        f"{status} {kind}".strip() + (f" ({count})" if len(counted) > 1 else "")
        for (status, kind), count in sorted(counted.items(), key=lambda item: (-item[1], item[0]))
    )


def _wrong(outcome: Outcome) -> str:
    case = outcome.case
    answer, right = f"{outcome.status} {outcome.kind}", f"{case.status} {case.kind}"
    return f"`{case.filename}`: {answer.strip()}, and it must be {right.strip()}"
