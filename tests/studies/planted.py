"""Pairs made by code with the likeness that is right, compared by a running service in three ways."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from core.ranking.likeness import Likeness
from tests.service.support import Running, serving, settings_in
from tests.studies.common import write

NONE = "none"
GROUPED = frozenset({"same", "scaled", "mirrored", "variant"})
LIKENESSES = ("same", "scaled", "mirrored", "variant", "part_of", "pose", "similar", "weak")


@dataclass(frozen=True, eq=False)
class PlantedPair:
    """Two files, the likenesses of the second to the first that are right, and its scale if it has one."""

    kind: str
    name: str
    files: tuple[bytes, bytes]
    right: frozenset[Likeness]
    scale: float | None = None
    formats: tuple[str, str] = ("off", "off")


@dataclass(frozen=True)
class Compared:
    """A pair and the answers to it: likenesses, and relative error of the scale (0 where none is known)."""

    pair: PlantedPair
    likeness: str
    right: bool
    error: float
    milliseconds: float
    query: str
    duplicates: str = NONE

    @property
    def agreed(self) -> bool:
        """Whether /query, /compare and /duplicates say the same; the last knows copies and variants alone."""
        grouped = self.likeness if self.likeness in GROUPED else NONE
        return self.query == self.likeness and self.duplicates == grouped


def compared(pairs: Iterable[PlantedPair]) -> list[Compared]:
    """Store the files of each pair in a new archive, compare them, and name pairs of another likeness.

    Then search with the first among the pair, and report the duplicates of the archive.
    """
    answers: list[Compared] = []
    members: list[tuple[str, str]] = []
    with TemporaryDirectory() as folder, serving(settings_in(Path(folder))) as running:
        for pair in pairs:
            tag = f"pair {len(answers)}"
            names = (f"{pair.kind} {pair.name} {number}.{end}" for number, end in enumerate(pair.formats))
            first, second = (
                running.store(data, name, tags=tag)["id"]
                for data, name in zip(pair.files, names, strict=True)
            )
            members.append((first, second))
            answer = running.client.post("/compare", json={"first": first, "second": second})
            told = answer.raise_for_status().json()
            asked = running.client.get(f"/shapes/{first}/similar", params={"tag": tag, "top_k": 1})
            (result,) = asked.raise_for_status().json()["results"]
            found = result["likeness"]
            right = told["likeness"] in pair.right
            error = abs(told["scale"] / pair.scale - 1.0) if right and pair.scale is not None else 0.0
            answers.append(
                Compared(pair, told["likeness"], right, error, told["milliseconds"]["likeness"], found)
            )
            if not right:
                expected = " or ".join(sorted(pair.right))
                print(f"{pair.kind}, {pair.name}: {told['likeness']}, not {expected}; cc {told['cc']:.4f}")
        for number, (first, second) in enumerate(members):
            told = _duplicates(running, f"pair {number}")
            answers[number] = replace(answers[number], duplicates=told.get((first, second), NONE))
    for answer in answers:
        if not answer.agreed:
            words = f"{answer.query} by /query and {answer.duplicates} by /duplicates, not {answer.likeness}"
            print(f"{answer.pair.kind}, {answer.pair.name}: {words}")
    return answers


def _duplicates(running: Running, tag: str) -> dict[tuple[str, str], str]:
    """Return the likeness of each duplicate with a tag to the first of its group, by the ids of both."""
    report: dict[str, Any] = {"unjudged": 1}
    while report["unjudged"]:
        options = {"variants": True, "scaled": True, "tag": tag}
        report = running.client.get("/duplicates", params=options).raise_for_status().json()
    ids = [[(member["shape"]["id"], member["likeness"]) for member in group] for group in report["groups"]]
    return {(group[0][0], member): likeness for group in ids for member, likeness in group}


def write_table(path: Path, answers: list[Compared]) -> None:
    """Write a row for each kind of pair: the likenesses, the largest error of the scale, and the time."""
    rows = []
    for kind in dict.fromkeys(answer.pair.kind for answer in answers):
        chosen = [answer for answer in answers if answer.pair.kind == kind]
        counts = Counter(answer.likeness for answer in chosen)
        row = {"planted": kind, "pairs": len(chosen), "right": sum(answer.right for answer in chosen)}
        row |= {"agreed": sum(answer.agreed for answer in chosen)}
        row |= {likeness: counts[likeness] for likeness in LIKENESSES}
        row |= {"largest_scale_error": max(answer.error for answer in chosen)}
        rows.append(row | {"median_ms": median(answer.milliseconds for answer in chosen)})
    write(path, rows)
