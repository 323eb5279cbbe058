"""`isoshape evaluate`, against the pipeline asked pair by pair."""

import json
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.special import logit

from core.descriptors.registry import descriptors_of
from core.embedding import Embedding
from core.evaluation.retrieval_measures import evaluate
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.class_probability import pooled_log_odds
from core.ranking.differences import differences_of
from core.ranking.diffusion import all_contextual_scores
from service.datasets import read_collection
from service.evaluation.pairwise_scores import embed_files, pair_densities, score_pairs, worker_pool
from service.evaluation.retrieval import spread
from service.index.cache import SAMPLE, sampled
from tests.service.cli.conftest import CLASSES, Run, mesh_bytes
from tests.service.processes import runs
from tests.service.support import wait_until

KEYS = [
    "collection", "setting", "rank_by", "shapes", "classes", "nn", "ft", "st", "e", "dcg", "map",
    "occurrence_skewness", "most_often_wrong", "cc", "per_class",
]  # fmt: skip


@pytest.fixture(scope="module")
def pool() -> Iterator[Executor]:
    with worker_pool(DEFAULT, 1) as pool:
        yield pool


def test_every_ranking_from_one_run(collection: Path, embeddings: list[Embedding], run: Run) -> None:
    done = run("evaluate", collection, "--rank-by", "all", "--json")
    assert done.status == 0
    reports = json.loads(done.stdout)
    assert [report["rank_by"] for report in reports] == ["cc", "ssd", "sim", "combined", "contextual"]
    pipeline = Pipeline(DEFAULT)
    rows = [pipeline.score(embedding, embeddings) for embedding in embeddings]
    cc = np.stack([row.cc for row in rows])
    combined = np.stack(
        [pipeline.combined(own, embeddings, row) for row, own in zip(rows, embeddings, strict=True)]
    )
    matrices = {
        "cc": cc,
        "ssd": -np.stack([row.ssd for row in rows]),
        "sim": np.stack([row.sim for row in rows]),
        "combined": combined,
        "contextual": all_contextual_scores(logit(combined)),
    }
    labels = [label for _, label in read_collection(collection)]
    for report in reports:
        assert list(report) == KEYS
        about = [report[key] for key in ("collection", "setting", "shapes", "classes")]
        assert about == ["made", "default", 9, 3]
        expected = evaluate(matrices[report["rank_by"]], labels, larger_is_closer=True)
        for name in KEYS[5:-2]:
            assert report[name] == pytest.approx(getattr(expected, name), abs=1e-9)
        same = np.equal.outer(labels, labels)[np.triu_indices(9, 1)]
        values = cc[np.triu_indices(9, 1)]
        for pairs, chosen in (("same", same), ("other", ~same)):
            assert report["cc"][pairs]["pairs"] == chosen.sum()
            assert report["cc"][pairs]["quantiles"]["0.5"] == pytest.approx(
                np.median(values[chosen]), abs=1e-9
            )
            assert report["cc"][pairs]["matched"] == (values[chosen] >= 0.98).mean()
        assert list(report["per_class"]) == list(CLASSES)
        assert report["per_class"]["cup"]["st"] == pytest.approx(expected.per_class["cup"].st)


def test_the_densities_of_a_large_collection_are_those_in_its_sample() -> None:
    points = np.random.default_rng(0).random((SAMPLE + 100, 2))
    distances = cdist(points, points)
    sample = sampled(np.arange(1, len(points) + 1))
    found = pair_densities(distances, 1.0, lifts=False)
    for i in (sample[0], np.setdiff1d(np.arange(len(points)), sample)[0]):
        own = np.sort(distances[i, sample[sample != i]])[6]
        assert found[i, i] == pytest.approx(own)


def test_pairs_are_scored_once_and_mirrored(pool: Executor, embeddings: list[Embedding]) -> None:
    chosen = [embeddings[i] for i in (0, 1, 4, 8)]
    steps: list[int] = []
    pipeline = Pipeline(DEFAULT)
    scores = score_pairs(pool, chosen, steps.append)
    described = [descriptors_of(one) for one in chosen]
    assert sum(steps) == 6
    for i, embedding in enumerate(chosen):
        row = pipeline.score(embedding, chosen)
        assert scores.cc[i] == pytest.approx(row.cc, abs=1e-9)
        assert scores.ssd[i] == pytest.approx(row.ssd, abs=1e-9)
        assert scores.sim[i] == pytest.approx(row.sim, abs=1e-9)
        differences = differences_of(descriptors_of(embedding), described, row)
        for name in ("spectral", "global_distance", "part", "part_distance", "reliability"):
            assert getattr(scores.differences, name)[i] == pytest.approx(getattr(differences, name), abs=1e-9)
        for name, distances in differences.distances.items():
            assert scores.differences.distances[name][i] == pytest.approx(distances, abs=1e-9)
        around = replace(
            differences,
            spectral_density=scores.differences.spectral_density[i],
            view_density=scores.differences.view_density[i],
            network_density=scores.differences.network_density[i],
        )
        assert scores.combined[i] == pytest.approx(pooled_log_odds(around), abs=1e-6)
    assert (scores.combined == scores.combined.T).all()


def test_workers_give_the_same_embedding_and_name_what_is_bad(
    pool: Executor, collection: Path, embeddings: list[Embedding]
) -> None:
    files = [path for path, _ in read_collection(collection)][:2]
    results = embed_files(pool, [*files, collection / "nothing.off", collection / "x.txt"], print)
    for result, embedding in zip(results[:2], embeddings[:2], strict=True):
        assert isinstance(result, Embedding)
        assert result.signature.tobytes() == embedding.signature.tobytes()
        assert result.positions.tobytes() == embedding.positions.tobytes()
    assert results[2:] == ["No such file or directory", "No such file or directory"]


def test_one_ranking_is_one_object_and_bad_files_are_reported(tmp_path: Path, run: Run) -> None:
    for label in ("cup", "pliers"):
        for pose in range(2):
            (tmp_path / f"{label}{pose}.off").write_bytes(mesh_bytes(label, pose))
    (tmp_path / "bad.off").write_bytes(b"OFF\n")
    rows = "".join(f"{path.name},{path.name.rstrip('01.of')}\n" for path in sorted(tmp_path.glob("*.off")))
    (tmp_path / "labels.csv").write_text("file,class\n" + rows + "gone.off,cup\n", encoding="utf-8")
    done = run("evaluate", tmp_path, "--json", "--rank-by", "ssd")
    report = json.loads(done.stdout)
    assert list(report) == KEYS
    assert (report["shapes"], report["classes"], report["rank_by"]) == (4, 2, "ssd")
    assert done.status == 1
    assert [line.split(": ")[:2] for line in done.stderr.splitlines()] == [
        [f"{tmp_path}/bad.off", "malformed-mesh"],
        [f"{tmp_path}/gone.off", "No such file or directory"],
        ["isoshape", "2 of 6 files could not be used"],
    ]


def test_tables_of_the_paper_setting_uncapped(collection: Path, run: Run) -> None:
    options = ("--setting", "paper", "--uncapped", "--limit", 4, "--rank-by", "cc", "--rank-by", "ssd")
    done = run("evaluate", collection, *options)
    assert (done.status, done.stderr) == (0, "")
    assert "made, setting paper: 4 shapes, 2 classes" in done.stdout
    lines = [line.split() for line in done.stdout.splitlines()]
    assert [line[0] for line in lines if len(line) == 9 and line[0] in {"cc", "ssd", "sim"}] == ["cc", "ssd"]
    per_class = [(line[0], line[-4]) for line in lines if line and line[0] in CLASSES]
    assert per_class == 2 * [(label, "2") for label in CLASSES[:2]]


def test_no_collection(tmp_path: Path, run: Run) -> None:
    missing = run("evaluate", tmp_path / "nowhere")
    assert (missing.status, missing.stderr) == (1, f"isoshape: {tmp_path}/nowhere: there is no such folder\n")
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "a.off").write_bytes(b"nothing")
    nothing = run("evaluate", tmp_path)
    assert nothing.status == 1
    assert nothing.stderr.splitlines()[-1] == "isoshape: no file could be used"
    assert run("evaluate", tmp_path, "--setting", "best").status == 2


def made(sizes: dict[str, int]) -> list[tuple[Path, str]]:
    return [(Path(f"{label}{i}"), label) for label, size in sizes.items() for i in range(size)]


@pytest.mark.parametrize("count", [2, 4, 7, 20, 38, 189, 190, 500])
def test_a_sample_is_spread_over_the_classes(count: int) -> None:
    files = made({f"class {c:02d}": 10 for c in range(19)})
    chosen = spread(files, count)
    assert len(chosen) == min(count, 190)
    assert chosen == [file for file in files if file in set(chosen)]
    sizes = [sum(label == name for _, label in chosen) for name in {label for _, label in chosen}]
    assert len(sizes) == min(19, max(1, count // 2))
    assert max(sizes) - min(sizes) <= 1
    assert min(sizes) >= 2


def test_a_sample_falls_back_on_small_classes() -> None:
    files = made({"a": 1, "b": 2, "c": 1})
    assert [label for _, label in spread(files, 3)] == ["a", "b", "b"]
    assert spread(made({"a": 1, "b": 1}), 2) == made({"a": 1, "b": 1})


def test_the_workers_of_a_command_that_is_killed_end_too() -> None:
    script = (
        "import os, time\n"
        "from core.parameters import DEFAULT\n"
        "from service.evaluation.pairwise_scores import worker_pool\n"
        "with worker_pool(DEFAULT, 1) as pool:\n"
        "    print(pool.submit(os.getpid).result(), flush=True)\n"
        "    time.sleep(600)\n"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as command:
        assert command.stdout is not None
        worker = int(command.stdout.readline())
        assert runs(worker)
        command.kill()
    wait_until(lambda: not runs(worker), seconds=60)
