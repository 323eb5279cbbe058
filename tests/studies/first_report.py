"""Times of the first report on duplicates over machine parts made by code, and its truth by force.

    python -m tests.studies.first_report DIR [--count 60] [--no-force]

The parts are stored twice: by a service that seeks duplicates in the background, and by one that does not, so
that a request seeks them all. Exits with status 1 unless both reports are equal, and equal to the groups of
every pair by force, which takes minutes for 60 parts and hours for 300.
"""

import asyncio
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import combinations, islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from core.io import write_mesh
from core.mesh.mesh import Mesh
from core.registration.similarity import RESIDUAL
from service.collection import DEFAULT_COLLECTION
from service.compute import tasks
from service.container import Container
from service.duplicates.groups import MIN_CC
from service.search import repository
from service.search.likeness import stored_mesh
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter
from tests.service.support import Running, serving, settings_in
from tests.studies.common import run, write
from tests.studies.kinship import COPIES, FAMILIES, TOLERANCES, VARIANTS, changed_part
from tests.studies.machine_parts import Drawing, Family, part

CLIENTS = 3
"""Uploads at a time."""

NEW, PLANTED, AMONG = 7, 3, 10
"""Of ten parts seven are new, two are copies and one is a variant."""


def parts(count: int, seed: int = 0) -> Iterator[tuple[str, bytes]]:
    """Yield names and files of `count` parts; each copy and each variant is of an earlier part."""
    yield from islice(_parts(50_000 + 100_000 * seed), count)


def _parts(number: int) -> Iterator[tuple[str, bytes]]:
    drawn: list[tuple[Family, int, float]] = []
    while True:
        for _ in range(NEW):
            number += 1
            drawn.append((FAMILIES[number % len(FAMILIES)], number, TOLERANCES[number % len(TOLERANCES)]))
            family, drawing, tolerance = drawn[-1]
            yield _named(family, drawing, "first", number, part(family, Drawing(drawing, tolerance)))
        for place in range(PLANTED):
            rng = np.random.default_rng([number, place])
            family, drawing, tolerance = drawn[rng.integers(len(drawn))]
            kinds = VARIANTS if place == PLANTED - 1 else COPIES
            kind = str(kinds[rng.integers(len(kinds))])
            mesh, _ = changed_part(family, drawing, tolerance, kind, number + place)
            yield _named(family, drawing, kind.replace("/", " of "), AMONG * number + place, mesh)


def _named(family: Family, number: int, kind: str, key: int, mesh: Mesh) -> tuple[str, bytes]:
    return f"{family}-{number}-{kind}-{key}.stl", write_mesh(mesh, "stl")


Groups = set[frozenset[str]]


def groups_by_force(container: Container) -> tuple[Groups, Groups]:
    """Return the ids of the shapes of each group of two or more, without and with variants.

    The shapes are those of the default collection. Every pair whose match has the least CC is registered from
    both files.
    """
    return asyncio.run(_groups(container))


async def _groups(container: Container) -> tuple[Groups, Groups]:
    with container.database.read() as session:
        active = container.pipelines.current(session)
        numbers = shapes_repository.numbers(session, ShapeFilter(DEFAULT_COLLECTION.number))
        shapes = shapes_repository.records(session, DEFAULT_COLLECTION.number, numbers)
        entries = active.index.current(session)
        embeddings = dict(zip(entries.shapes.tolist(), entries.embeddings.tolist(), strict=True))
        by_number = repository.embedding_records(session, list(embeddings.values()))
    records = [by_number[embeddings[shape.number]] for shape in shapes]
    meshes = [await stored_mesh(container, DEFAULT_COLLECTION.number, shape.id) for shape in shapes]
    parameters = active.pipeline.parameters
    copies, variants = list(range(len(shapes))), list(range(len(shapes)))
    for i, j in combinations(range(len(shapes)), 2):
        if (await container.queue.match(records[i], records[j], active.pipeline)).cc < MIN_CC:
            continue
        pair = meshes[i], meshes[j], records[i], records[j]
        copy = await container.queue.do(tasks.registered, *pair, parameters)
        if copy is not None and copy.residual <= RESIDUAL:
            variants = _joined(variants, i, j)
            copies = copies if copy.difference is not None else _joined(copies, i, j)
    ids = [shape.id for shape in shapes]
    return _sets(ids, copies), _sets(ids, variants)


def _joined(labels: list[int], i: int, j: int) -> list[int]:
    return [labels[j] if label == labels[i] else label for label in labels]


def _sets(ids: list[str], labels: list[int]) -> Groups:
    sets = (
        frozenset(shape for shape, its in zip(ids, labels, strict=True) if its == label)
        for label in set(labels)
    )
    return {group for group in sets if len(group) > 1}


def complete(running: Running) -> dict[str, Any]:
    """Return the report when all shapes are judged."""
    while (answer := running.client.get("/duplicates").json())["unjudged"]:
        pass
    return dict(answer)


def store(running: Running, files: Iterable[tuple[str, bytes]]) -> None:
    """Upload files, several at a time."""
    with ThreadPoolExecutor(CLIENTS) as threads:
        for _ in threads.map(lambda file: running.store(file[1], file[0]), files):
            pass


def groups(answer: dict[str, Any], field: str) -> Groups:
    """Return the groups of a report, by a field of their shapes."""
    return {frozenset(member["shape"][field] for member in group) for group in answer["groups"]}


def main(folder: Path, count: int, workers: int, force: bool) -> bool:
    """Write first-report.csv; return whether the groups are right."""
    files = list(parts(count + 1))
    rows, reports, right = [], [], True
    for background in (False, True):
        with TemporaryDirectory() as scratch:
            settings = settings_in(Path(scratch), workers=workers, duplicates_in_background=background)
            with serving(settings) as running:
                begun = time.monotonic()
                store(running, files[:-1])
                stored = time.monotonic()
                report = complete(running)
                judged = time.monotonic()
                reports.append(groups(report, "name"))
                if force and background:
                    right = groups(report, "id") == groups_by_force(running.container)[0]
                    print(f"equal to every pair by force: {right}")
                running.store(files[-1][1], files[-1][0])
                again = time.monotonic()
                complete(running)
                rows.append(
                    {
                        "background": background,
                        "parts": count,
                        "stored_s": stored - begun,
                        "report_s": judged - stored,
                        "compared": report["compared"],
                        "registered": report["aligned"],
                        "groups": len(report["groups"]),
                        "one_more_ms": 1e3 * (time.monotonic() - again),
                    }
                )
    write(folder / "first-report.csv", rows)
    print(f"both reports are equal: {reports[0] == reports[1]}")
    return right and reports[0] == reports[1]


if __name__ == "__main__":
    run(main, __doc__, count=60, workers=2, force=True)
