"""The samples in which densities are measured: the same whatever the history and the process."""

from pathlib import Path

import numpy as np
import pytest

from core.ranking.local_density import densities_in, density_sample
from core.serialization import descriptors_from_bytes
from service.collection import DEFAULT_COLLECTION
from service.index import cache
from service.index.cache import CollectionSample, sampled
from service.search import repository
from service.search.caches import collection_sample
from tests.service.engines import on_both
from tests.service.support import Running, query, serving, settings_in, small_file

pytestmark = on_both

SHAPES = 9


def sample_of(running: Running) -> CollectionSample:
    with running.container.database.read() as session:
        active_pipeline = running.container.pipelines.current(session)
        return collection_sample(session, running.container, active_pipeline, DEFAULT_COLLECTION.number)


def test_a_sample_has_the_shapes_of_least_hash(engine: str) -> None:
    rng = np.random.default_rng(0)
    shapes = rng.permutation(np.unique(rng.integers(1, 2**40, size=3_000)))
    chosen = np.sort(shapes[sampled(shapes)])
    assert len(chosen) == cache.SAMPLE
    for _ in range(3):
        order = rng.permutation(len(shapes))
        assert (np.sort(shapes[order][sampled(shapes[order])]) == chosen).all()
    # Each further shape replaces one of the sample at most, and a small set is sampled whole.
    for more in rng.integers(1, 2**40, size=50):
        together = np.append(shapes, more)
        after = together[sampled(together)]
        assert len(np.setdiff1d(after, chosen)) <= 1
        assert set(np.setdiff1d(after, chosen).tolist()) <= {int(more)}
    assert shapes[:100][sampled(shapes[:100])].tolist() == sorted(shapes[:100].tolist())


def test_numbers_of_one_kind_are_sampled_evenly(engine: str) -> None:
    """Shapes often come class by class, or class after class in turn."""
    shapes = np.arange(1, 100_001)
    chosen = shapes[sampled(shapes)]
    for group in (chosen % 7, chosen % 20, chosen * 10 // 100_001):
        counts = np.bincount(group)[np.unique(group)]
        expected = cache.SAMPLE / len(counts)
        assert ((counts - expected) ** 2 / expected).sum() < 3 * len(counts)


def test_memory_and_database_sample_the_same_after_any_history(
    tmp_path: Path, engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cache, "SAMPLE", 5)
    monkeypatch.setattr("service.search.repository.SAMPLE", 5)
    with serving(settings_in(tmp_path)) as running:
        ids = [running.store(small_file(n), f"{n}.off")["id"] for n in range(SHAPES)]
        first = sample_of(running)
        assert first.embeddings.shape == (5,)
        answer = query(running.client, small_file(50), top_k=20, rank_by="combined").json()["results"]
        extra = running.store(small_file(60), "extra.off")
        query(running.client, small_file(51))
        running.client.delete(f"/shapes/{extra['id']}")
        assert sample_of(running).embeddings.tolist() == first.embeddings.tolist()
        again = query(running.client, small_file(50), top_k=20, rank_by="combined").json()["results"]
        assert again == answer
        with running.container.database.read() as session:
            active_pipeline = running.container.pipelines.current(session)
            by_database = repository.sampled_embeddings(
                session, active_pipeline.fingerprint, DEFAULT_COLLECTION.number
            )
            records = repository.embedding_records(session, first.embeddings.tolist())
        assert by_database == first.embeddings.tolist()
        shapes = [descriptors_from_bytes(records[number]) for number in first.embeddings.tolist()]
        for cached in (False, True):
            found = sample_of(running).of_stored(first.embeddings.tolist(), shapes)
            expected = densities_in(density_sample(shapes), shapes)
            assert (found.spectral == expected.spectral).all(), cached
            assert (found.view == expected.view).all(), cached
            assert found.kinds.kinds.tolist() == expected.kinds.kinds.tolist(), cached
            assert (found.kinds.coordinates == expected.kinds.coordinates).all(), cached
        assert len(ids) == SHAPES
    with serving(settings_in(tmp_path)) as other:
        assert query(other.client, small_file(50), top_k=20, rank_by="combined").json()["results"] == answer
