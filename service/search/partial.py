"""Partial queries: the stored shapes that a part may belong to."""

from dataclasses import replace

import numpy as np

from core.arrays import Bytes, Floats, Ints
from core.descriptors.partial import part_distances, whole_spin_images
from core.descriptors.spin_images import KEYPOINTS
from core.ranking.shortlist import least
from service.compute.tasks import part_of_mesh
from service.container import Container
from service.observability.timings import Timings
from service.search.caches import CandidateReader
from service.search.records import Candidates, Query
from service.search.scoring import DESCRIPTOR_BATCH, by_embedding

SHORTLIST_FACTOR = 2.5
"""Factor of the number of candidates from which a query compares a shortlist: this may miss the whole of a
part, whose signature is another."""


async def nearest_wholes(
    container: Container,
    query: Query,
    reader: CandidateReader,
    candidates: Candidates,
    count: int,
    timings: Timings,
) -> tuple[Candidates, dict[int, float]]:
    """Return the candidates that the query is most likely a part of, and the part distance of each shape.

    Stages: describe the query as a part; rank all candidates by
    `core.descriptors.partial.part_distances`. Deleted and unreadable candidates are left out.

    At most `count` candidates are returned, the least distance first. The mesh of the query is read if its
    record does not describe it as a part.
    """
    with timings.stage("spin_images"):
        part = query.spin_images[KEYPOINTS:]
        if not len(part) and query.mesh is not None:
            parameters = query.active_pipeline.pipeline.parameters
            part = await container.queue.do(part_of_mesh, await query.mesh(), parameters)
    with timings.stage("compare"):
        (distances,) = await by_embedding(
            container, candidates, lambda numbers: _distances(reader, part, numbers), DESCRIPTOR_BATCH, 1
        )
        finite = np.flatnonzero(np.isfinite(distances))
        distances, candidates = distances[finite], replace(candidates.only(finite), shortlisted=False)
        shapes = candidates.entries.shapes
        distance_of = dict(zip(shapes.tolist(), distances.tolist(), strict=True))
        return candidates.only(least(distances, shapes, count)), distance_of


def _distances(reader: CandidateReader, part: Bytes, embeddings: Ints) -> Floats:
    """Return distances of a part from c embeddings, shape (1, c); NaN for deleted and unreadable ones."""
    numbers = embeddings.tolist()
    described = reader.descriptors(numbers)
    known = [i for i, number in enumerate(numbers) if number in described]
    distances = np.full((1, len(numbers)), np.nan)
    wholes = [whole_spin_images(described[numbers[i]].arrays["spin_images"]) for i in known]
    distances[0, known] = part_distances(part, wholes)
    return distances
