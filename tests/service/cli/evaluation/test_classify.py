"""`isoshape classify`, against the classification of scores asked pair by pair."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from core.evaluation.classification import classify
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from service.datasets import read_collection


@pytest.fixture(scope="module")
def expected(collection, embeddings):
    """Names, labels, and the scores of all pairs."""
    names, labels = zip(*((str(path), label) for path, label in read_collection(collection)), strict=True)
    rows = [Pipeline(DEFAULT).score(query, embeddings) for query in embeddings]
    return (
        list(names),
        list(labels),
        {by: np.array([getattr(row, by) for row in rows]) for by in ("cc", "ssd")},
    )


@pytest.mark.parametrize("rank_by", ["cc", "ssd"])
def test_the_object(run, collection, expected, rank_by):
    names, labels, scores = expected
    truth = classify(scores[rank_by], labels, larger_is_closer=rank_by == "cc")
    done = run("classify", collection, "--rank-by", rank_by, "--json")
    assert (done.status, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert (found["collection"], found["rank_by"]) == ("made", rank_by)
    assert found["threshold"] == pytest.approx(truth.threshold)
    assert found["balanced_accuracy"] == pytest.approx(truth.balanced_accuracy)
    assert [shape["file"] for shape in found["shapes"]] == names
    assert [shape["class"] for shape in found["shapes"]] == labels
    assert [shape["neighbour"] for shape in found["shapes"]] == [names[i] for i in truth.neighbour]
    np.testing.assert_allclose([shape["score"] for shape in found["shapes"]], truth.score)
    assert [shape["found"] for shape in found["shapes"]] == [
        labels[i] if matched else None for i, matched in zip(truth.neighbour, truth.matched, strict=True)
    ]
    counts = {
        "right": (truth.matched & truth.right).sum(),
        "wrong": (truth.matched & ~truth.right).sum(),
        "unmatched": (~truth.matched).sum(),
    }
    assert {name: found[name] for name in counts} == counts


def test_the_tables(run, collection, expected):
    done = run("classify", collection)
    assert done.status == 0
    for name in expected[0]:
        assert Path(name).name in done.stdout
    for title in ("first neighbours by cc, unmatched below", "balanced accuracy", "most often taken for"):
        assert title in done.stdout


def test_fewer_shapes_and_a_file_that_cannot_be_used(run, collection, tmp_path):
    copy = tmp_path / "made"
    shutil.copytree(collection, copy)
    (copy / "cup" / "cup-9.off").write_bytes(b"OFF\n1 1 0\n")
    done = run("classify", copy, "--json")
    assert done.status == 1
    assert "cup-9.off" in done.stderr
    assert "1 of 10 files could not be used" in done.stderr
    assert len(json.loads(done.stdout)["shapes"]) == 9
    assert len(json.loads(run("classify", collection, "--limit", 6, "--json").stdout)["shapes"]) == 6


def test_two_classes_are_too_few(run, collection, tmp_path):
    shutil.copytree(collection / "cup", tmp_path / "two" / "cup")
    shutil.copytree(collection / "pliers", tmp_path / "two" / "pliers")
    done = run("classify", tmp_path / "two")
    assert done.status == 1
    assert "three classes or more" in done.stderr
