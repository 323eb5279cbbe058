"""`isoshape benchmark`: its page, its object, and what it is asked."""

import json
import subprocess
import sys
from functools import partial

import pytest

from service.cli.studies import benchmark
from service.studies.benchmark import ingesting, pictures
from service.studies.benchmark.page import BenchmarkResults, page
from service.studies.benchmark.timing import Spread

pytestmark = pytest.mark.studies


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """One mesh, one turn, two sizes."""
    few = partial(benchmark.embedding_rows, vertices=1000, meshes=1, repeats=1)
    monkeypatch.setattr(benchmark, "embedding_rows", few)
    grown = partial(benchmark.growth_rows, sizes=(800, 1600), repeats=1)
    monkeypatch.setattr(benchmark, "growth_rows", grown)
    once = partial(benchmark.matching_rows, vertices=1000, pairs=1, repeats=1, matches=1)
    monkeypatch.setattr(benchmark, "matching_rows", once)


def test_the_processors_of_a_process_are_chosen():
    everything = ingesting.processors()
    with ingesting.on(everything[:1]):
        asked = [sys.executable, "-c", "import os; print(len(os.sched_getaffinity(0)))"]
        assert subprocess.run(asked, capture_output=True, check=True).stdout == b"1\n"
    assert ingesting.processors() == everything


def test_thumbnails(run, collection, monkeypatch):
    few = partial(benchmark.picture_rows, vertices=(500,), meshes=2)
    monkeypatch.setattr(benchmark, "picture_rows", few)
    done = run("benchmark", collection, "--only", "pictures", "--json")
    assert (done.status, done.stderr) == (0, "")
    (row,) = json.loads(done.stdout)["pictures"]
    assert row["vertices"] == 500
    assert all(row[which]["count"] == 2 for which in ("drawn", "kept", "unchanged"))
    assert 1_000 < row["size"] < 100_000
    spreads = {which: Spread(**row[which]) for which in ("drawn", "kept", "unchanged")}
    text = page(
        BenchmarkResults(pictures=[pictures.PictureRow(**{**row, **spreads})]),
        "isoshape benchmark",
        picture=False,
    )
    assert "## Thumbnails over HTTP" in text
    assert "| 500 |" in text


def test_a_page_and_its_picture(run, collection, tmp_path):
    done = run("benchmark", collection, "--only", "growth", "--only", "embedding", "--out", tmp_path / "out")
    assert (done.status, done.stderr) == (0, "")
    text = (tmp_path / "out" / "benchmark.md").read_text(encoding="utf-8")
    assert "Measured by `isoshape benchmark made --only growth --only embedding`" in text
    assert text.count("\n## ") == 2
    assert "LaPy's" not in text
    assert (tmp_path / "out" / "benchmark-growth.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


def test_an_object_with_lapy_beside_it(run, collection):
    done = run("benchmark", collection, "--only", "embedding", "--peers", "--json")
    assert (done.status, done.stderr) == (0, "")
    (row,) = json.loads(done.stdout)["embedding"]
    assert row["ratio"]["median"] > 0.0
    assert row["stages"]["read"]["count"] == 1


def test_one_match_as_a_page(run, collection):
    done = run("benchmark", collection, "--only", "match")
    assert (done.status, done.stderr) == (0, "")
    assert "Measured by `isoshape benchmark made --only match`" in done.stdout
    assert "## One match of two stored shapes" in done.stdout


def test_an_object_with_pyfmaps_beside_it(run, collection):
    done = run("benchmark", collection, "--only", "match", "--peers", "--json")
    assert (done.status, done.stderr) == (0, "")
    (row,) = json.loads(done.stdout)["match"]
    assert row["many"]["count"] == row["peer"]["match"]["count"] == 1
    assert row["peer"]["many"]["median"] > 0.0


@pytest.mark.parametrize(
    ("subject", "loader", "name"),
    [("embedding", "shapedna", "lapy"), ("match", "functional_maps", "pyFM")],
)
def test_a_peer_that_is_not_installed(run, monkeypatch, subject, loader, name):
    def missing():
        raise ImportError(name=name)

    monkeypatch.setattr(benchmark, loader, missing)
    done = run("benchmark", "--only", subject, "--peers")
    assert (done.status, done.stdout) == (2, "")
    assert f"{name} is not installed: pip install isoshape[peers]" in done.stderr
