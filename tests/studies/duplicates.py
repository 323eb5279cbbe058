"""The report on duplicates: planted copies among poses, and the times and the truth by force of machine
parts.

    python -m tests.studies.duplicates DIR [--poses 8] [--seed 0] [--count 60] [--no-force]

duplicates.csv: the gallery holds poses of one body of every class, which differ by pose alone; where the body
is stiff, as a cup, other individuals. And it holds people, several poses of each, every one meshed anew.
Forty of these shapes are stored again as copies under other names: turned, scaled, split, simplified and
mirrored.

first-report.csv: machine parts are stored twice, by a service that seeks duplicates in the background, and by
one that does not, so that a request seeks them all.

Exits with status 1 unless all copies are found, and nothing else, and both reports on parts are equal, and
equal to the groups of every pair by force, which takes minutes for 60 parts and hours for 300.
"""

import asyncio
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import combinations, islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.gallery import CLASSES
from core.gallery.bodies import make_body
from core.io import write_mesh
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh
from core.registration.similarity import RESIDUAL, best_similarity
from service.collection import DEFAULT_COLLECTION
from service.compute import tasks
from service.container import Container
from service.search import repository
from service.search.likeness import stored_mesh
from service.search.records import proportions_of
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter
from tests.people import make_person
from tests.service.support import Running, serving, settings_in
from tests.studies.common import run, write
from tests.studies.copies import KINDS, copy
from tests.studies.kinship import COPIES, TOLERANCES, VARIANTS, changed_part
from tests.studies.machine_parts import FAMILIES, Drawing, Family, part

PLANTED = 40
PEOPLE = 4

DIFFERENT = 0.01
"""Poses lie farther apart than this, over the root of the area: some draws differ by one degree."""

UNLIKE = 0.05
"""Difference of the radii at unit area of shapes that are no variants: twice that of the service."""

CLIENTS = 3
"""Uploads of parts at a time."""

NEW, CHANGED, AMONG = 7, 3, 10
"""Shares of new parts, of copies and of variants."""

Groups = set[frozenset[str]]


def poses_of(label: str, poses: int) -> list[Mesh]:
    """Return poses that differ, of one body; other individuals where few of its poses do."""
    body = make_body(label)
    made: list[Mesh] = []
    for pose in range(2 * poses):
        mesh = body.posed(pose)
        if len(made) < poses and all(apart(mesh, other) > DIFFERENT for other in made):
            made.append(mesh)
    return made if len(made) == poses else [make_body(label, pose).posed(pose) for pose in range(poses)]


def apart(first: Mesh, second: Mesh) -> float:
    """Return the distance of two poses of one mesh after the best similarity, over the root of the area."""
    motion = best_similarity(first.vertices, second.vertices, sign=1, scaled=True)
    squares = ((second.vertices - motion.apply(first.vertices)) ** 2).sum(axis=1)
    return float(np.sqrt(squares.mean() / face_areas(second.vertices, second.faces).sum()))


def complete(running: Running) -> dict[str, Any]:
    """Return the report when all shapes are judged."""
    while (answer := running.client.get("/duplicates", params={"scaled": True}).json())["unjudged"]:
        pass
    return dict(answer)


def planted_copies(folder: Path, poses: int, seed: int) -> bool:
    """Write duplicates.csv; return whether the report has all copies, and nothing else."""
    shapes = {
        f"{label}-{pose}": mesh for label in CLASSES for pose, mesh in enumerate(poses_of(label, poses))
    }
    shapes |= {
        f"people-{body}-{pose}": make_person(body, pose) for body in range(PEOPLE) for pose in range(4)
    }
    names = sorted(shapes)
    chosen = [names[i] for i in np.random.default_rng(seed).permutation(len(names))[:PLANTED]]
    planted = {}
    with TemporaryDirectory() as scratch, serving(settings_in(Path(scratch))) as running:
        for name, mesh in shapes.items():
            running.store(write_mesh(mesh, "off"), f"{name}.off")
        for number, name in enumerate(chosen):
            kind = KINDS[number % len(KINDS)]
            planted[f"{name}.off", f"copy-{number}.off"] = kind
            running.store(write_mesh(copy(shapes[name], kind, number), "off"), f"copy-{number}.off")
        began = time.monotonic()
        answer = complete(running)
        seconds = time.monotonic() - began
    counts = f"{answer['compared']:,} pairs compared, {answer['aligned']:,} registered"
    print(f"{answer['shapes']} shapes: {counts} in {seconds:.1f} s")
    reported = {
        (group[0]["shape"]["name"], member["shape"]["name"]): member
        for group in answer["groups"]
        for member in group[1:]
    }
    rows = []
    for kind in KINDS:
        pairs = [pair for pair, how in planted.items() if how == kind]
        members = [reported[pair] for pair in pairs if pair in reported]
        row: dict[str, Any] = {"planted": kind, "copies": len(pairs), "found": len(members)}
        for likeness in ("same", "scaled", "mirrored"):
            row[likeness] = sum(member["likeness"] == likeness for member in members)
        row["largest_residual"] = max((member["residual"] for member in members), default=np.nan)
        rows.append(row | {"least_cc": min((member["cc"] for member in members), default=np.nan)})
    write(folder / "duplicates.csv", rows)
    for pair in sorted(set(reported) ^ set(planted)):
        print(f"{' and '.join(pair)}: {'no copies' if pair in reported else 'a copy that was not found'}")
    return set(reported) == set(planted)


def parts(count: int, seed: int = 0) -> Iterator[tuple[str, bytes]]:
    """Yield names and files of `count` parts; each copy and each variant is of an earlier part."""
    yield from islice(_parts(50_000 + 100_000 * seed), count)


def _parts(number: int) -> Iterator[tuple[str, bytes]]:
    drawn: list[tuple[Family, int, float]] = []
    families = tuple(FAMILIES)
    while True:
        for _ in range(NEW):
            number += 1
            drawn.append((families[number % len(families)], number, TOLERANCES[number % len(TOLERANCES)]))
            family, drawing, tolerance = drawn[-1]
            yield _named(family, drawing, "first", number, part(family, Drawing(drawing, tolerance)))
        for index in range(CHANGED):
            rng = np.random.default_rng([number, index])
            family, drawing, tolerance = drawn[rng.integers(len(drawn))]
            kinds = VARIANTS if index == CHANGED - 1 else COPIES
            kind = str(kinds[rng.integers(len(kinds))])
            mesh, _ = changed_part(family, drawing, tolerance, kind, number + index)
            yield _named(family, drawing, kind.replace("/", " of "), AMONG * number + index, mesh)


def _named(family: Family, number: int, kind: str, key: int, mesh: Mesh) -> tuple[str, bytes]:
    return f"{family}-{number}-{kind}-{key}.stl", write_mesh(mesh, "stl")


def groups_by_force(running: Running) -> tuple[Groups, Groups]:
    """Return the ids of the shapes of each group of two or more, without and with variants.

    The shapes are those of the default collection. Every pair whose radii at unit area are near is registered
    from both files.
    """
    # In the loop of the service, which its turns belong to.
    loop = running.server.servers[0].get_loop()
    return asyncio.run_coroutine_threadsafe(_groups(running.container), loop).result()


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
    radii = [proportions_of(shape.facts).radius for shape in shapes]
    copies, variants = np.zeros((2, len(shapes), len(shapes)), dtype=bool)
    for i, j in combinations(range(len(shapes)), 2):
        pair = records[i], records[j]
        if abs(radii[i] - radii[j]) > UNLIKE:
            continue
        registered = await container.queue.do(tasks.registered, meshes[i], meshes[j], *pair, parameters)
        if registered is not None and registered.residual <= RESIDUAL:
            variants[i, j] = True
            copies[i, j] = registered.difference is None
    ids = np.array([shape.id for shape in shapes])
    return _joined(ids, copies), _joined(ids, variants)


def _joined(ids: np.ndarray, linked: np.ndarray) -> Groups:
    count, labels = connected_components(coo_array(linked), directed=False)
    sets = (frozenset(ids[labels == label].tolist()) for label in range(count))
    return {group for group in sets if len(group) > 1}


def groups(answer: dict[str, Any], field: str) -> Groups:
    """Return the groups of a report, by a field of their shapes."""
    return {frozenset(member["shape"][field] for member in group) for group in answer["groups"]}


def first_report(folder: Path, count: int, workers: int, *, force: bool) -> bool:
    """Write first-report.csv; return whether the groups are right."""
    files = list(parts(count + 1))
    rows, reports, right = [], [], True
    for background in (False, True):
        with TemporaryDirectory() as scratch:
            settings = settings_in(Path(scratch), workers=workers, duplicates_in_background=background)
            with serving(settings) as running, ThreadPoolExecutor(CLIENTS) as threads:
                times = [time.monotonic()]
                list(threads.map(lambda file: running.store(file[1], file[0]), files[:-1]))
                times.append(time.monotonic())
                report = complete(running)
                times.append(time.monotonic())
                reports.append(groups(report, "name"))
                if force and background:
                    right = groups(report, "id") == groups_by_force(running)[0]
                    print(f"equal to every pair by force: {right}")
                running.store(files[-1][1], files[-1][0])
                again = time.monotonic()
                complete(running)
                one_more = 1e3 * (time.monotonic() - again)
        stored, judged = np.diff(times).tolist()
        row = {"background": background, "parts": count, "stored_s": stored, "report_s": judged}
        row |= {"compared": report["compared"], "registered": report["aligned"]}
        rows.append(row | {"groups": len(report["groups"]), "one_more_ms": one_more})
    write(folder / "first-report.csv", rows)
    print(f"both reports are equal: {reports[0] == reports[1]}")
    return right and reports[0] == reports[1]


def main(folder: Path, poses: int, seed: int, count: int, workers: int, force: bool) -> bool:
    """Write both tables; return whether all is right."""
    return planted_copies(folder, poses, seed) & first_report(folder, count, workers, force=force)


if __name__ == "__main__":
    run(main, __doc__, poses=8, seed=0, count=60, workers=2, force=True)
