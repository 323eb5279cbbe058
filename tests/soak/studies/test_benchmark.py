"""`isoshape benchmark` against running services: a folder is stored, archives are searched, clients wait."""

import json
from functools import partial

from service.cli.studies import benchmark
from service.studies.benchmark import ingesting, load, searching
from service.studies.benchmark.page import BenchmarkResults, page
from service.studies.benchmark.timing import Spread


def test_a_folder_stored_on_all_processors_and_on_one(run, collection, monkeypatch):
    monkeypatch.setattr(benchmark, "ingesting_rows", partial(benchmark.ingesting_rows, turns=1))
    before = ingesting.processors()
    done = run("benchmark", collection, "--only", "ingest", "--json")
    assert (done.status, done.stderr) == (0, "")
    rows = json.loads(done.stdout)["ingest"]
    assert [row["processors"] for row in rows] == sorted({len(before), 1}, reverse=True)
    assert all(row["shapes"] > 0 and row["a_second"]["median"] > 0.0 for row in rows)
    assert ingesting.processors() == before
    shown = [ingesting.IngestRow(**{**row, "a_second": Spread(**row["a_second"])}) for row in rows]
    text = page(BenchmarkResults(ingest=shown), "isoshape benchmark", picture=False)
    assert "## A folder stored" in text
    assert text.rstrip().count("| 1.00 |") >= 1


def test_queries_of_archives_made_of_the_collection(run, collection, monkeypatch):
    fewer = partial(benchmark.searching_rows, queries=3)
    monkeypatch.setattr(benchmark, "searching_rows", fewer)
    monkeypatch.setattr(searching, "EXHAUSTIVE", 10)
    monkeypatch.setattr(searching, "SHORTLIST_FROM", 10)
    monkeypatch.setattr(
        searching, "cascade_rows", partial(searching.cascade_rows, queries=3, lengths=[(6, 5, 1)])
    )
    sizes = ("--shapes", 10, "--shapes", 14)
    done = run("benchmark", collection, "--only", "search", *sizes, "--json")
    assert (done.status, done.stderr) == (0, "")
    found = json.loads(done.stdout)["search"]
    assert [(row["shapes"], row["exhaustive"], row["compared"]) for row in found["rows"]] == [
        (10, False, 9),
        (10, True, 9),
        (14, False, 13),
    ]
    for row in found["rows"]:
        assert 0.0 < row["median"] <= row["p95"]
        assert row["memory"] > 2**20
    kept = found["kept"]
    assert [row["rank_by"] for row in kept] == ["cc", "cc", "combined", "combined"]
    for cascade, everything in (kept[:2], kept[2:]):
        assert (cascade["length"], cascade["reranked"], cascade["finalists"]) == (6, 5, 1)
        assert everything["length"] is everything["reranked"] is everything["finalists"] is None
        assert everything["first"] == 1.0
    text = page(
        BenchmarkResults(
            search=[searching.SearchRow(**row) for row in found["rows"]],
            kept=[searching.CascadeRow(**kept[0])],
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
