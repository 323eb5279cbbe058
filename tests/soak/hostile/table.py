"""The tables of docs/hostile.md: what came of the hostile files, row by row, and what the service held."""

from collections import Counter
from collections.abc import Mapping

from tests.soak.hostile.case import ROWS
from tests.soak.hostile.serving import Memory
from tests.soak.hostile.uploading import Outcome


def table(outcomes: list[Outcome], held: Mapping[str, Memory]) -> str:
    """Both tables, and a line of totals between them.

    Parameters
    ----------
    outcomes : list of Outcome
    held : mapping
        Memory by the moment at which it was looked at.
    """
    rows = ["| input | files | answer | worst seconds | peak memory, MiB |", "|---|---:|---|---:|---:|"]
    for key, title in ROWS.items():
        own = [outcome for outcome in outcomes if outcome.case.row == key]
        seconds, peak = max(outcome.seconds for outcome in own), max(outcome.peak for outcome in own)
        rows.append(f"| {title} | {len(own)} | {_answers(own)} | {seconds:.2f} | {peak:.0f} |")
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
