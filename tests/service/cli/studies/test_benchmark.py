"""`isoshape benchmark`: its page, its object, and what it is asked."""

import json
import subprocess
import sys
from functools import partial

import pytest

from service.cli.studies import benchmark
from service.studies.benchmark import ingesting, load, pictures, searching
from service.studies.benchmark.page import BenchmarkResults, page
from service.studies.benchmark.timing import Spread


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """One mesh, one turn, two sizes."""
    few = partial(benchmark.embedding_rows, vertices=1000, meshes=1, repeats=1)
    monkeypatch.setattr(benchmark, "embedding_rows", few)
    grown = partial(benchmark.growth_rows, sizes=(800, 1600), repeats=1)
    monkeypatch.setattr(benchmark, "growth_rows", grown)
    once = partial(benchmark.matching_rows, vertices=1000, pairs=1, repeats=1, matches=1)
    monkeypatch.setattr(benchmark, "matching_rows", once)


def test_queries_of_archives_made_of_the_collection(run, collection, monkeypatch):
    fewer = partial(benchmark.searching_rows, queries=3)
    monkeypatch.setattr(benchmark, "searching_rows", fewer)
    monkeypatch.setattr(searching, "EXHAUSTIVE", 10)
    monkeypatch.setattr(
        searching, "cascade_rows", partial(searching.cascade_rows, queries=3, lengths=[(6, 5, 1)])
    )
    sizes = ("--shapes", 10, "--shapes", 14)
    done = run("benchmark", collection, "--only", "search", *sizes, "--json")
    assert (done.status, done.stderr) == (0, "")
    found = json.loads(done.stdout)["search"]
    assert [(row["shapes"], row["exhaustive"], row["compared"]) for row in found["rows"]] == [
        (10, True, 9),
        (14, False, 13),
    ]
    for row in found["rows"]:
        assert 0.0 < row["median"] <= row["p95"]
        assert row["memory"] > 2**20
    cascade, everything = found["kept"]
    assert (cascade["length"], cascade["reranked"], cascade["finalists"]) == (6, 5, 1)
    assert everything["length"] is everything["reranked"] is everything["finalists"] is None
    assert everything["first"] == 1.0
    text = page(
        BenchmarkResults(
            search=[searching.SearchRow(**row) for row in found["rows"]],
            kept=[searching.CascadeRow(**cascade)],
        ),
        "isoshape benchmark",
        picture=False,
    )
    assert "## Queries over HTTP" in text
    assert "| 6 | 5 | 1 |" in text


def test_clients_at_once(run, collection, monkeypatch):
    short = partial(benchmark.load_row, shapes=10, capacity_seconds=1.0, alone=2, seconds=1.0)
    monkeypatch.setattr(benchmark, "load_row", short)
    done = run("benchmark", collection, "--only", "load", "--json")
    assert (done.status, done.stderr) == (0, "")
    (row,) = json.loads(done.stdout)["load"]
    assert (row["shapes"], row["querying"], row["ingesting"], row["errors"]) == (10, 8, 2, 0)
    assert row["queries"] > 0
    assert 0.0 < row["median"] <= row["p95"]
    text = page(BenchmarkResults(load=[load.LoadRow(**row)]), "isoshape benchmark", picture=False)
    assert "## Many clients at once" in text


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
