"""Pairs made by code with the likeness that is right, compared by a running service."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from core.ranking.likeness import Likeness
from tests.service.support import serving, settings_in
from tests.studies.common import write

LIKENESSES = ("same", "scaled", "mirrored", "variant", "pose", "similar", "weak")


@dataclass(frozen=True, eq=False)
class PlantedPair:
    """Two files, the likenesses of the second to the first that are right, and its scale if it has one."""

    kind: str
    name: str
    files: tuple[bytes, bytes]
    right: frozenset[Likeness]
    scale: float | None = None
    format: str = "off"


@dataclass(frozen=True)
class Compared:
    """A pair and the answer to it: likeness, and relative error of the scale (0 where none is known)."""

    pair: PlantedPair
    likeness: str
    right: bool
    error: float
    milliseconds: float


def compared(pairs: Iterable[PlantedPair]) -> list[Compared]:
    """Store the files of each pair in a new archive, compare them, and name pairs of another likeness."""
    answers = []
    with TemporaryDirectory() as folder, serving(settings_in(Path(folder))) as running:
        for pair in pairs:
            names = (f"{pair.kind} {pair.name} {number}.{pair.format}" for number in (0, 1))
            first, second = (
                running.store(data, name)["id"] for data, name in zip(pair.files, names, strict=True)
            )
            answer = running.client.post("/compare", json={"first": first, "second": second})
            told = answer.raise_for_status().json()
            right = told["likeness"] in pair.right
            error = abs(told["scale"] / pair.scale - 1.0) if right and pair.scale is not None else 0.0
            answers.append(Compared(pair, told["likeness"], right, error, told["milliseconds"]["likeness"]))
            if not right:
                expected = " or ".join(sorted(pair.right))
                print(f"{pair.kind}, {pair.name}: {told['likeness']}, not {expected}; cc {told['cc']:.4f}")
    return answers


def write_table(path: Path, answers: list[Compared]) -> None:
    """Write a row for each kind of pair: the likenesses, the largest error of the scale, and the time."""
    rows = []
    for kind in dict.fromkeys(answer.pair.kind for answer in answers):
        chosen = [answer for answer in answers if answer.pair.kind == kind]
        counts = Counter(answer.likeness for answer in chosen)
        row = {"planted": kind, "pairs": len(chosen), "right": sum(answer.right for answer in chosen)}
        row |= {likeness: counts[likeness] for likeness in LIKENESSES}
        row |= {"largest_scale_error": max(answer.error for answer in chosen)}
        rows.append(row | {"median_ms": median(answer.milliseconds for answer in chosen)})
    write(path, rows)
