"""`isoshape benchmark`: what it measures of a small collection, and what it prints."""

import json
from functools import partial

import pytest

from service.cli.evaluation import benchmark
from service.evaluation import benchmark_service

pytestmark = pytest.mark.studies


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """One mesh, one turn, two sizes."""
    sizes = {
        "embedding_rows": {"vertices": 1000, "meshes": 1, "repeats": 1},
        "growth_rows": {"sizes": (800, 1600), "runs": 1},
        "matching_rows": {"vertices": 1000, "pairs": 1, "repeats": 1},
        "searching_rows": {"queries": 3},
        "ingesting_rows": {"turns": 1},
    }
    for name, options in sizes.items():
        monkeypatch.setattr(benchmark, name, partial(getattr(benchmark, name), **options))
    monkeypatch.setattr(benchmark_service, "EXHAUSTIVE", 10)
    monkeypatch.setattr(benchmark_service, "SHORTLIST_FROM", 10)
    few = partial(benchmark_service.cascade_rows, queries=3, lengths=[(6, 5, 1)])
    monkeypatch.setattr(benchmark_service, "cascade_rows", few)


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
    assert [row["processors"] for row in rows] == sorted({len(before), 1}, reverse=True)
    assert all(row["shapes"] == 9 and row["shapes_a_second"]["median"] > 0.0 for row in rows)
    assert benchmark_service.processors() == before


def test_queries_of_archives_made_of_the_collection(run, collection):
    sizes = ("--shapes", 10, "--shapes", 14)
    done = run("benchmark", collection, "--only", "search", *sizes, "--json")
    assert (done.status, done.stderr) == (0, "")
    tables = json.loads(done.stdout)
    assert [(row["shapes"], row["exhaustive"], row["compared"]) for row in tables["search"]] == [
        (10, False, 9),
        (10, True, 9),
        (14, False, 13),
    ]
    for row in tables["search"]:
        assert 0.0 < row["median_ms"] <= row["p95_ms"]
        assert row["memory_mib"] > 1.0
        assert row["processor_ms"] > 0.0
    cascades = tables["cascade"]
    assert [row["ranked_by"] for row in cascades] == ["cc", "cc", "combined", "combined"]
    for limited, everything in (cascades[:2], cascades[2:]):
        assert (limited["shortlist"], limited["reranked"], limited["in_full"]) == (6, 5, 1)
        assert everything["shortlist"] is everything["reranked"] is everything["in_full"] is None
        assert everything["same_first"] == everything["recall_3"] == everything["recall_10"] == 1.0
