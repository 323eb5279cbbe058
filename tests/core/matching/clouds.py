"""Clouds made by hand, as embeddings hold them, and what matching reads of them."""

import numpy as np
from scipy.spatial.distance import cdist

from core.embedding import Embedding, Spectrum
from core.matching.kernels.match_record import decoded
from core.matching.kernels.one_to_many import MATCH_RECORD
from core.matching.match_records import compared, embedding_key, keyed_match_record, search_rounds
from core.matching.quantised_points import rounded
from core.parameters import DEFAULT
from tests.core.matching.reference import encoded_reference
from tests.core.shapes import FACTS


def cloud(rng, count, k):
    """Centred, of unit root mean square radius, each coordinate weaker than the one before; float32.

    `rng` is a seed or a generator.
    """
    points = np.random.default_rng(rng).normal(size=(count, k)) * 0.8 ** np.arange(k)
    points -= points.mean(axis=0)
    return (points / np.sqrt((points**2).sum(axis=1).mean())).astype(np.float32)


def embedded(clouds, m):
    """An embedding of clouds, one a domain, rounded: m samples, each point in the region of the nearest."""
    points = clouds[0]
    places = np.arange(m, dtype=np.int32)
    nothing = np.empty(0, dtype=np.float32)
    edges = np.stack([places[:-1], places[1:]], axis=1)
    regions = cdist(points, points[:m]).argmin(axis=1)
    regions[:m] = places
    clouds = [rounded(one, regions) for one in clouds]
    return Embedding(
        fingerprint="",
        facts=FACTS,
        positions=np.zeros((m, 3), dtype=np.float32),
        vertices=places,
        graph_edges=edges,
        graph_lengths=nothing,
        tree_edges=edges,
        regions=regions.astype(np.int32),
        signature=nothing,
        spectra=tuple(Spectrum(f"{i}", np.ones(20, dtype=np.float32), one) for i, one in enumerate(clouds)),
        pieces=np.ones((1, 6), dtype=np.float32),
        descriptors={},
    )


def random_embedding(seed, m, d, k=DEFAULT.spectral.dimensions, blocks=2):
    """An embedding of random clouds: d points in `blocks` domains of k dimensions, m of them samples."""
    rng = np.random.default_rng(seed)
    return embedded([cloud(rng, d, k) for _ in range(blocks)], m)


def degenerate(count, k):
    """Clouds without volume, by what they are; of k >= 5 dimensions."""
    points = cloud(1, count, k)
    flat, line = points.copy(), np.zeros_like(points)
    flat[:, 4:], line[:, 0] = 0.0, points[:, 0]
    repeated = np.repeat(points[: count // 3], 3, axis=0)
    return {
        "points that coincide": repeated,
        "flat": flat,
        "a line": line,
        "two places": points[np.arange(count) % 2],
    }


def parameters_for(k):
    """The default in k dimensions."""
    return DEFAULT.with_values(
        name="by hand",
        spectral={"dimensions": k},
        matching={"first_dimensions": min(3, k), "search_dimensions": min(6, k)},
    )


def random_record(seed, m, d, k, blocks):
    """The arrays that matching reads of a `random_embedding`."""
    return record_of(random_embedding(seed, m, d, k, blocks), parameters_for(k))


def columns(seed, count, k, scale=1.0):
    """A cloud in rows of coordinates."""
    return np.ascontiguousarray(cloud(seed, count, k).T) * np.float32(scale)


def compared_pair(first, second, parameters=DEFAULT):
    """Scores and map, of the first shape to the second if the first is that of the lesser key."""
    record = encoded_reference(second)
    data, ends = record.view(np.uint8), np.array([record.nbytes])
    scores, rotation = compared(encoded_reference(first), data, ends, MATCH_RECORD, search_rounds(parameters))
    return scores[0], rotation


def record_of(embedding, parameters=DEFAULT):
    return decoded(keyed_match_record(embedding, embedding_key(embedding), parameters).copy())
