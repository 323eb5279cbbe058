"""docs/hostile.md: what came of the hostile files, row by row."""

from collections import Counter

from tests.hostile.case import ROWS
from tests.hostile.uploading import Outcome

MIB = 1 << 20
HEAD = """\
# Hostile uploads

Files made by `tests/hostile/`, uploaded one after another over HTTP to an `isoshape serve` with default
settings and two workers. The answer to each file is fixed beforehand; `201` is for a file that is strange and
yet a mesh. Memory is that of the service and all its processes, what they share counted for each, at its peak
while a file was worked on.

    python -m tests.hostile --out docs/hostile.md

"""


def page(outcomes: list[Outcome], at_rest: int, after: list[int]) -> str:
    """The page.

    Parameters
    ----------
    outcomes : list of Outcome
    at_rest : int
        Bytes of memory before the first file.
    after : list of int
        The same after each further round of all files that are not large.
    """
    rows = ["| input | files | answer | worst seconds | peak memory, MiB |", "|---|---:|---|---:|---:|"]
    for key, title in ROWS.items():
        own = [outcome for outcome in outcomes if outcome.case.row == key]
        seconds, peak = max(outcome.seconds for outcome in own), max(outcome.peak for outcome in own)
        rows.append(f"| {title} | {len(own)} | {_answers(own)} | {seconds:.2f} | {peak / MIB:.0f} |")
    wrong = [outcome for outcome in outcomes if not outcome.right]
    failed = sum(outcome.status >= 500 for outcome in outcomes)
    silent = sum(outcome.status == 0 for outcome in outcomes)
    rounds = ", ".join(f"{bytes_ / MIB:.0f}" for bytes_ in after)
    lines = [
        *rows,
        "",
        f"{len(outcomes)} files: {len(wrong)} answered otherwise than they must be, {failed} answered with "
        f"5xx, {silent} not answered in time.",
        f"Memory before the first file {at_rest / MIB:.0f} MiB; after each of {len(after)} more rounds of "
        f"all files but the large ones {rounds} MiB.",
    ]
    return HEAD + "\n".join(lines) + "\n" + "".join(f"* {_wrong(outcome)}\n" for outcome in wrong)


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
