"""`isoshape benchmark --only ingest`: a folder that is stored with all processors, and with one."""

import json
from functools import partial

from service.cli.studies import benchmark
from service.studies.benchmark import ingesting
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
