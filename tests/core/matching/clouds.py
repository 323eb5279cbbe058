"""Clouds made by hand, as embeddings hold them, and what matching reads of them."""

import numpy as np
from scipy.spatial.distance import cdist

from core.embedding import Embedding, Spectrum
from core.matching.match_records import embedding_key, make_match_record
from core.parameters import DEFAULT
from tests.core.shapes import FACTS


def cloud(rng, count, k):
    """Centred, of unit root mean square radius, each coordinate weaker than the one before; float32."""
    points = rng.normal(size=(count, k)) * 0.8 ** np.arange(k)
    points -= points.mean(axis=0)
    return (points / np.sqrt((points**2).sum(axis=1).mean())).astype(np.float32)


def embedded(clouds, m):
    """An embedding of clouds, one a domain: m samples, each point in the region of the nearest of them."""
    points = clouds[0]
    places = np.arange(m, dtype=np.int32)
    nothing = np.empty(0, dtype=np.float32)
    edges = np.stack([places[:-1], places[1:]], axis=1)
    regions = cdist(points, points[:m]).argmin(axis=1)
    regions[:m] = places
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
        descriptors={},
    )


def parameters_for(k):
    """The default in k dimensions."""
    return DEFAULT.with_values(
        name="by hand",
        spectral={"dimensions": k},
        matching={"first_dimensions": min(3, k), "search_dimensions": min(6, k)},
    )


def random_record(seed, m, d, k, blocks):
    """What matching reads of random clouds of d points in `blocks` domains of k dimensions, m the samples."""
    rng = np.random.default_rng(seed)
    return record_of(embedded([cloud(rng, d, k) for _ in range(blocks)], m), parameters_for(k))


def record_of(embedding, parameters=DEFAULT):
    return make_match_record(embedding, embedding_key(embedding), parameters)
