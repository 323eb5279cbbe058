"""Embeddings ready to be compared: what is kept of them, what a query does without, and finalists."""

import re
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from numpy.typing import NDArray

from core.arrays import Floats
from core.descriptors.registry import descriptors_of
from core.descriptors.views import signature_distance, view_signature
from core.embedding import Scores
from core.matching.match_records import match_record, score_match_records
from core.parameters import DEFAULT
from core.ranking.class_probability import pooled_log_odds
from core.ranking.differences import TYPICAL_SIM, coarse_differences, differences_of
from core.ranking.local_density import (
    LocalDensities,
    all_log_eigenvalues,
    densities_in,
    density_sample,
    estimated_densities,
)
from core.ranking.reranking import coarse_samples, rerank
from core.serialization import embedding_from_bytes
from service.index.cache import ABOUT, EmbeddingCache
from service.search import caches, repository
from service.search.caches import CacheWarmer
from tests.core.ranking.test_differences import coarse
from tests.service.support import Running, query, serving, settings_in, small_file, wait_until

STORED = 12

PLAIN: dict[str, int] = {}
NARROW = [{"search_bytes": 0}, {"search_bytes": 300_000}]
SHORT = {"shortlist_from": 5, "shortlist_length": 9, "finalists": 2}


def array(value: float, length: int = 100) -> np.ndarray:
    return np.full(length, value, dtype=np.float32)


def test_the_least_recently_used_goes_first() -> None:
    cache = EmbeddingCache(1200)
    for number in (1, 2, 3):
        cache.put(number, array(number))
    assert list(cache.get([1, 9])) == [1]
    cache.put(4, array(4))
    assert cache.missing([1, 2, 3, 4]) == [2]
    assert (len(cache), cache.nbytes) == (3, 1200)
    assert [found[0] for found in cache.get([4, 3, 1]).values()] == [4, 3, 1]


def test_the_room_is_that_of_the_values() -> None:
    cache = EmbeddingCache(1200)
    for value in (array(1), array(1), array(2, 50)):
        cache.put(1, value)
    assert (len(cache), cache.nbytes) == (1, 200)
    assert cache.get([1])[1][0] == 2
    cache.put(2, array(1, 400))
    assert cache.missing([1, 2]) == [2]
    for number in (2, 3, 4):
        cache.put(number, array(number))
    assert cache.missing([1, 2, 3, 4]) == [1]
    cache.resize(800)
    assert cache.missing([2, 3, 4]) == [2]
    cache.keep(np.array([4, 7]))
    assert (cache.missing([3, 4]), len(cache), cache.nbytes) == ([3], 1, 400)
    cache.keep(np.empty(0, dtype=np.int64))
    assert (len(cache), cache.nbytes) == (0, 0)
    cache.resize(-5)
    cache.put(4, array(4))
    assert len(cache) == 0


def test_the_free_count_goes_by_the_values_that_are_there() -> None:
    cache = EmbeddingCache(10 * ABOUT)
    assert cache.free_count() == 10
    cache.put(1, array(1, ABOUT // 8))
    assert cache.free_count() == 19
    assert EmbeddingCache(0).free_count() == 0


def test_many_threads_at_once() -> None:
    cache = EmbeddingCache(4000)

    def work(seed: int) -> None:
        rng = np.random.default_rng(seed)
        for number in rng.integers(30, size=500).tolist():
            cache.put(number, array(number))
            for found, values in cache.get(range(30)).items():
                assert values[0] == found

    threads = [Thread(target=work, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (len(cache), cache.nbytes) == (10, 4000)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, dict[str, float]]]:
    """The folder of an archive of 12 shapes, and an answer with every match record cached."""
    folder = tmp_path_factory.mktemp("cache")
    with serving(settings_in(folder)) as running:
        for number in range(STORED):
            running.store(small_file(number), f"{number}.off")
        wait_until(lambda: len(cache_of(running)) == STORED, seconds=300)
        return folder, answer(running)


@pytest.fixture(scope="module")
def folder(made: tuple[Path, object]) -> Path:
    return made[0]


@pytest.fixture(scope="module")
def roomy(made: tuple[object, dict[str, dict[str, float]]]) -> dict[str, dict[str, float]]:
    return made[1]


@pytest.fixture(scope="module")
def running(folder: Path, request: pytest.FixtureRequest) -> Iterator[Running]:
    """A service over it, with the settings that the tests give."""
    with serving(settings_in(folder, **request.param)) as running:
        yield running


def cache_of(running: Running) -> EmbeddingCache:
    with running.container.database.read() as session:
        return running.container.pipelines.current(session).cache


def answer(running: Running, number: int = 20, **options: object) -> dict[str, dict[str, float]]:
    found = query(running.client, small_file(number), top_k=100, **options).json()
    assert found["compared"] == len(found["results"])
    return {
        result["shape"]["name"]: {kind: result[kind] for kind in ("cc", "ssd", "sim", "combined")}
        for result in found["results"]
    }


@pytest.mark.parametrize("running", [PLAIN], indirect=True)
def test_match_records_are_ready_soon_after_the_start_and_after_an_upload(
    running: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = cache_of(running)
    wait_until(lambda: len(cache) == STORED, seconds=300)
    record = running.store(small_file(30), "late.off")
    wait_until(lambda: len(cache) == STORED + 1, seconds=300)
    (shown,) = re.findall(r"^isoshape_rows_bytes (\S+)$", running.client.get("/metrics").text, re.MULTILINE)
    assert float(shown) == cache.nbytes
    with monkeypatch.context() as patch:
        patch.setattr(caches, "match_record_of_points", None)
        assert len(answer(running)) == STORED + 1
    running.client.delete(f"/shapes/{record['id']}")
    assert len(answer(running)) == STORED
    wait_until(lambda: len(cache) == STORED, seconds=300)


@pytest.mark.parametrize("running", [PLAIN], indirect=True)
def test_new_shapes_are_prepared_after_any_deletion(running: Running) -> None:
    """Rows of what is gone would fill the room, and be counted for those that lack."""
    cache = cache_of(running)
    wait_until(lambda: len(cache) == STORED, seconds=300)
    gone = [running.store(small_file(number), f"{number}.off")["id"] for number in (31, 32)]
    wait_until(lambda: len(cache) == STORED + 2, seconds=300)
    before = set(cache.missing(range(1000)))
    query(running.client, small_file(0), rank_by="combined")
    assert len(running.container.descriptors) == STORED + 2
    for shape in gone:
        running.client.delete(f"/shapes/{shape}")
    late = running.store(small_file(33), "late.off")
    wait_until(lambda: len(before - set(cache.missing(range(1000)))) == 1, seconds=300)
    wait_until(lambda: len(cache) == STORED + 1, seconds=300)
    wait_until(lambda: len(running.container.descriptors) == STORED, seconds=300)
    running.client.delete(f"/shapes/{late['id']}")


def test_a_record_that_cannot_be_read_is_left_out_and_stops_nothing(folder: Path, tmp_path: Path) -> None:
    shutil.copy(folder / "archive.sqlite3", tmp_path)
    with closing(sqlite3.connect(tmp_path / "archive.sqlite3")) as connection, connection:
        connection.execute("UPDATE embeddings SET record = x'00' WHERE number = 3")
    with serving(settings_in(tmp_path)) as other:
        wait_until(lambda: len(cache_of(other)) == STORED - 1, seconds=300)
        assert set(answer(other)) == {f"{number}.off" for number in range(STORED) if number != 2}


def test_an_unexpected_error_does_not_keep_the_service_from_answering(
    folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(caches, "warm_comparing", None)
        patch.setattr(CacheWarmer, "_put_records", None)
        with serving(settings_in(folder)) as other:
            assert len(answer(other)) == STORED
            wait_until(lambda: "embeddings could not be made ready" in caplog.messages, seconds=300)
    assert "the kernels of a search could not be loaded" in caplog.messages


@pytest.mark.parametrize("running", NARROW, indirect=True)
def test_without_room_answers_are_the_same(running: Running, roomy: dict[str, dict[str, float]]) -> None:
    assert answer(running) == roomy
    room = running.container.settings.search_bytes
    wait_until(lambda: cache_of(running).nbytes + running.container.descriptors.nbytes <= room, seconds=60)


@pytest.mark.parametrize("rank_by", ["cc", "combined"])
@pytest.mark.parametrize("running", [SHORT], indirect=True)
def test_finalists_are_those_that_reranking_puts_first(running: Running, rank_by: str) -> None:
    client = running.client
    shapes = client.get("/shapes").json()["shapes"]
    with running.container.database.read() as session:
        entries = running.container.pipelines.current(session).index.current(session)
        records = repository.embedding_records(session, entries.embeddings.tolist())
    embeddings = {
        shape["name"]: embedding_from_bytes(records[int(number)])
        for shape, number in zip(shapes, entries.embeddings, strict=True)
    }
    wanted = embeddings.pop("3.off")
    own = match_record(wanted, DEFAULT)

    def first(names: list[str], likeness: NDArray[np.floating], count: int) -> list[str]:
        return [names[place] for place in np.argsort(-likeness.astype(np.float64), kind="stable")[:count]]

    def near(distance: Callable[[str], float], count: int) -> list[str]:
        return sorted(embeddings, key=distance)[:count]

    shapes_of = {name: descriptors_of(embedding) for name, embedding in embeddings.items()}
    query_shape = descriptors_of(wanted)
    by_log_odds = rank_by == "combined"
    own_views = view_signature(wanted.descriptors["views"])
    by_signature = near(
        lambda name: np.linalg.norm(embeddings[name].signature - wanted.signature), 12 if by_log_odds else 9
    )
    by_views = near(
        lambda name: signature_distance(
            own_views, view_signature(embeddings[name].descriptors["views"])[None]
        )[0],
        12 if by_log_odds else 5,
    )
    names = [*by_signature, *(name for name in by_views if name not in by_signature)]

    sample = density_sample([query_shape, *shapes_of.values()])
    density = densities_in(sample, [query_shape])

    def estimated(names: list[str]) -> LocalDensities:
        stored = coarse([embeddings[name] for name in names])
        return estimated_densities(sample, stored.signatures, stored.view_signatures)

    def coarse_log_odds(
        names: list[str], cc: Floats | None = None, densities: tuple[LocalDensities, ...] = ()
    ) -> Floats:
        stored = coarse([embeddings[name] for name in names])
        return pooled_log_odds(coarse_differences(coarse([wanted]), stored, cc, *densities))

    if by_log_odds:
        names = first(names, coarse_log_odds(names), 9)
    samples = np.stack([coarse_samples(embeddings[name]) for name in names])
    rough = rerank(own, samples, DEFAULT).astype(np.float64)
    if by_log_odds:
        described = first(names, coarse_log_odds(names, rough, (density, estimated(names))), 3)
        rough = rough[[names.index(name) for name in described]]
        names = described
        chosen = [shapes_of[name] for name in names]
        kinds = sample.kinds.of(all_log_eigenvalues(chosen))
        sim = np.full(len(names), TYPICAL_SIM)
        rough = pooled_log_odds(
            differences_of(
                query_shape,
                chosen,
                Scores(rough, sim, sim),
                density,
                replace(estimated(names), kinds=kinds),
                skipped={"spin_images"},
            )
        )
    names = first(names, rough, 3)
    body = {"shape_id": next(s["id"] for s in shapes if s["name"] == "3.off"), "top_k": 1, "rank_by": rank_by}
    found = client.post("/query", json=body).json()
    assert found["compared"] == 3
    (result,) = found["results"]
    exact = score_match_records(own, [match_record(embeddings[name], DEFAULT) for name in names], DEFAULT)
    place = names.index(result["shape"]["name"])
    assert (result["cc"], result["ssd"], result["sim"]) == (
        exact.cc[place],
        exact.ssd[place],
        exact.sim[place],
    )
    if rank_by == "cc":
        assert place == exact.cc.argmax()
