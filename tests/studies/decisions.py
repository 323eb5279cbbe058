"""Planted pairs of copies in a source, decided by hand and by a rule, and what becomes of the decisions.

    python -m tests.studies.decisions DIR [--groups 200]

Each pair is a mesh and the same mesh turned. A row has the groups that are shown after a step, all of which
are undecided, the groups that are shown with `decided=true`, the decisions, and the seconds of the step.
Exits with status 1 if a decided pair comes back or is lost, or if a merge and its undo change a shape or a
byte of its file.
"""

import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from core.io import read_mesh, write_mesh
from core.mesh.mesh import Mesh
from service.cli.archives import reembed
from service.client import Client
from service.duplicates.decision_schemas import Rule
from service.duplicates.records import Decision
from tests.service.pipeline_files import write_parameters
from tests.service.support import serving, settings_in, small_file
from tests.studies.common import run, write

BY_HAND: tuple[Decision, ...] = ("same", "variant", "different", "ignore")
SCAN_SECONDS = 0.5

Groups = set[frozenset[str]]


def main(folder: Path, *, groups: int) -> bool:
    """Write the table of steps; return whether nothing came back, and nothing was lost."""
    place = Path(tempfile.mkdtemp(prefix="decisions-", dir=folder))
    try:
        rows = list(study(place, groups))
    finally:
        shutil.rmtree(place)
    write(folder / "decisions.csv", rows)
    return all(row["right"] for row in rows)


def study(place: Path, groups: int) -> Iterator[dict[str, Any]]:
    """Yield a row for each step."""
    root = place / "models"
    plant(root, groups)
    settings = settings_in(place, source_roots=(str(place),), undo_days=7.0)
    by_hand = groups // 2
    step = Step(groups)
    with serving(settings) as running, Client(str(running.client.base_url)) as client:
        source = client.add_source(str(root))
        scan(client, source.id)
        planted = planted_in(client, source.id)
        yield step.row("planted", client, shown=groups, right=found(client) == set(planted))
        for number, pair in enumerate(planted[:by_hand]):
            client.decide(sorted(pair), BY_HAND[number % len(BY_HAND)], decided_by="Ann", reason="looked at")
        yield step.row("by hand", client, shown=groups - by_hand)
        client.apply_rule(Rule(action="same", dry_run=False))
        yield step.row("by a rule", client, shown=0)
    with serving(settings) as running, Client(str(running.client.base_url)) as client:
        yield step.row("restart", client, shown=0)
        client.rescan_source(source.id)
        scan(client, source.id)
        yield step.row("rescan", client, shown=0)
    parameters = write_parameters(place)
    other = settings.model_copy(update={"pipeline": str(place / "few.json")})
    reembed(other, parameters)
    with serving(other) as running, Client(str(running.client.base_url)) as client:
        yield step.row("another pipeline", client, shown=0)
        before = state(client, planted)
        merged = [client.merge(sorted(pair)) for pair in planted]
        left = client.page(limit=1).total
        for each in merged:
            client.undo_merge(each.id)
        unchanged = left == groups and state(client, planted) == before
        yield step.row("merge and undo", client, shown=0, right=unchanged)


class Step:
    """The steps of the study, and their times."""

    def __init__(self, groups: int) -> None:
        self._groups, self._start = groups, time.monotonic()

    def row(self, kind: str, client: Client, *, shown: int, right: bool = True) -> dict[str, Any]:
        """Return the row of the step that has ended, and compare its groups with the right numbers."""
        undecided, decided = len(found(client)), len(found(client, decided=True))
        seconds, self._start = time.monotonic() - self._start, time.monotonic()
        right = right and (undecided, decided) == (shown, self._groups)
        decisions = sum(1 for _ in client.decisions())
        row = {"step": kind, "shown": undecided, "with decided": decided, "decisions": decisions}
        print(row | {"right": right}, flush=True)
        return row | {"right": right, "seconds": seconds}


def plant(root: Path, groups: int) -> None:
    """Write a folder for each pair."""
    for number in range(groups):
        mesh = read_mesh(small_file(number), "off")
        turned = Mesh(mesh.vertices[:, [1, 2, 0]] + 1.0, mesh.faces)
        folder = root / f"{number:03}"
        folder.mkdir(parents=True)
        (folder / f"{number} one.off").write_bytes(small_file(number))
        (folder / f"{number} two.off").write_bytes(write_mesh(turned, "off"))
    # A file that was written just now may still grow.
    time.sleep(2.5)


def scan(client: Client, source: str) -> None:
    """Wait until a scan has ended."""
    for _ in client.follow_source(source, seconds=SCAN_SECONDS):
        pass


def planted_in(client: Client, source: str) -> list[frozenset[str]]:
    """Return the ids of each pair, by its folder."""
    pairs: dict[str, set[str]] = {}
    for file in client.source_files(source):
        assert file.shape_id is not None
        pairs.setdefault(file.path.partition("/")[0], set()).add(file.shape_id)
    return [frozenset(pairs[name]) for name in sorted(pairs)]


def found(client: Client, **options: Any) -> Groups:
    """Return the groups of an archive, once all shapes are judged."""
    while (answer := client.duplicates(**options)).unjudged:
        pass
    return {frozenset(one.shape.id for one in group) for group in answer.groups}


def state(client: Client, pairs: Sequence[frozenset[str]]) -> list[Any]:
    """Return all that is told of the shapes, but for the time of their latest change, and their files."""
    ids = sorted(shape for pair in pairs for shape in pair)
    return [(client.shape(each).model_copy(update={"updated_at": None}), client.file(each)) for each in ids]


if __name__ == "__main__":
    run(main, __doc__, groups=200)
