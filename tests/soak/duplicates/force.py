"""Groups of copies by registering every pair of shapes, without candidates, judgements or kept pairs."""

import asyncio
from itertools import combinations

from core.registration.similarity import RESIDUAL
from service.collection import DEFAULT_COLLECTION
from service.compute import tasks
from service.container import Container
from service.duplicates.groups import MIN_CC
from service.search import repository
from service.search.likeness import stored_mesh
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter

Groups = set[frozenset[str]]


def groups_by_force(container: Container) -> tuple[Groups, Groups]:
    """The ids of the shapes of each group of two or more, without and with variants.

    The shapes are those of the default collection. Every pair whose match has the least CC is registered from
    both files.
    """
    return asyncio.run(_groups(container))


async def _groups(container: Container) -> tuple[Groups, Groups]:
    with container.database.read() as session:
        active = container.pipelines.current(session)
        numbers = shapes_repository.numbers(session, ShapeFilter(DEFAULT_COLLECTION.number))
        shapes = shapes_repository.records(session, active.fingerprint, DEFAULT_COLLECTION.number, numbers)
        entries = active.index.current(session)
        embeddings = dict(zip(entries.shapes.tolist(), entries.embeddings.tolist(), strict=True))
        found = repository.embedding_records(session, list(embeddings.values()))
    records = [found[embeddings[shape.number]] for shape in shapes]
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
    return [labels[j] if each == labels[i] else each for each in labels]


def _sets(ids: list[str], labels: list[int]) -> Groups:
    sets = (
        frozenset(one for one, its in zip(ids, labels, strict=True) if its == label) for label in set(labels)
    )
    return {each for each in sets if len(each) > 1}
