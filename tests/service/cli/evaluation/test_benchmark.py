"""`isoshape benchmark`: what it measures of a small collection, and what it prints."""

import json
from functools import partial

import pytest

from service.cli.evaluation import benchmark
from service.evaluation import benchmark_service
from service.evaluation.benchmark_service import WIDE

pytestmark = pytest.mark.studies


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """One mesh, one turn, two sizes."""
    sizes = {
        "embedding_rows": {"vertices": 1000, "meshes": 1, "repeats": 1},
        "growth_rows": {"sizes": (800, 1600), "runs": 1},
        "matching_rows": {"vertices": 1000, "pairs": 1, "repeats": 1},
        "searching_rows": {"queries": 3},
        "graph_rows": {"size": 20},
        "ingesting_rows": {"turns": 1},
    }
    for name, options in sizes.items():
        monkeypatch.setattr(benchmark, name, partial(getattr(benchmark, name), **options))
    monkeypatch.setattr(benchmark_service, "EXHAUSTIVE", 10)
    monkeypatch.setattr(benchmark_service, "SHORTLIST_FROM", 10)
    monkeypatch.setattr(benchmark_service, "LENGTHS", ((6, 1),))


def test_the_method_as_tables(run, collection):
    asked = ("--only", "growth", "--only", "embedding", "--only", "match")
    done = run("benchmark", collection, *asked)
    assert (done.status, done.stderr) == (0, "")
    for title in ("cost against size", "a binary PLY embedded", "one match of two stored shapes"):
        assert title in " ".join(done.stdout.split())
    assert "Growth: seconds as vertices^" in done.stdout
    assert "glb" in done.stdout


def test_a_folder_stored_on_all_processors_and_on_one(run, collection):
    before = benchmark_service.processors()
    done = run("benchmark", collection, "--only", "ingest", "--json")
    assert (done.status, done.stderr) == (0, "")
    rows = json.loads(done.stdout)["ingest"]
    assert [(row["processors"], row["graph"]) for row in rows[:2]] == [
        (len(before), False),
        (len(before), True),
    ]
    assert [row["processors"] for row in rows[2:]] == [1][: len(before) - 1]
    assert all(row["shapes"] == 9 and row["shapes_a_second"]["median"] > 0.0 for row in rows)
    assert benchmark_service.processors() == before


def test_the_graph_of_an_archive_made_of_the_collection(run, collection):
    done = run("benchmark", collection, "--only", "graph", "--json")
    assert (done.status, done.stderr) == (0, "")
    (row,) = json.loads(done.stdout)["graph"]
    assert row["shapes"] == 20
    assert row["seconds"] > 0.0
    assert row["memory_mib"] > 1.0


def test_queries_of_archives_made_of_the_collection(run, collection):
    sizes = ("--shapes", 10, "--shapes", 14)
    done = run("benchmark", collection, "--only", "search", *sizes, "--json")
    assert (done.status, done.stderr) == (0, "")
    tables = json.loads(done.stdout)
    asked = [(10, False, 9), (10, True, 9), (14, False, 13)]
    assert [
        (row["shapes"], row["exhaustive"], row["compared"], row["ranked_by"]) for row in tables["search"]
    ] == [(*each, ranking) for each in asked for ranking in ("cc", "combined", "contextual")]
    for row in tables["search"]:
        assert 0.0 < row["median_ms"] <= row["p95_ms"]
        assert row["by_file_ms"] > 0.0
        assert row["memory_mib"] > 1.0
        assert row["processor_ms"] > 0.0
    cascades = tables["cascade"]
    assert [row["ranked_by"] for row in cascades] == ["cc", "cc", "combined", "combined"]
    for limited, wide in (cascades[:2], cascades[2:]):
        assert (limited["shortlist"], limited["in_full"]) == (6, 1)
        assert (wide["shortlist"], wide["in_full"]) == WIDE
        assert wide["same_first"] == wide["recall_3"] == wide["recall_10"] == 1.0
