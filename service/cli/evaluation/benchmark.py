"""`isoshape benchmark`: the time and memory of embedding, matching, searching and storing."""

import json
from collections.abc import Callable, Sequence
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

from service.cli.evaluation.options import AsJson
from service.console import print_table, progress
from service.evaluation.benchmark_method import (
    MANY,
    digits,
    embedding_rows,
    growth_exponents,
    growth_rows,
    matching_rows,
)
from service.evaluation.benchmark_service import SIZES, graph_rows, ingesting_rows, searching_rows
from service.evaluation.benchmark_shapes import read_source

Subject = StrEnum("Subject", ["EMBEDDING", "GROWTH", "MATCH", "SEARCH", "GRAPH", "INGEST"])
"""A part of the benchmark that can be measured alone."""

TITLES = {
    "embedding": "a binary PLY embedded",
    "growth": "cost against size: one mesh subdivided, each time in a new process",
    "match": f"one match of two stored shapes, milliseconds; one of many is one of {MANY}",
    "search": "queries over HTTP by the ids of stored shapes, and by a file",
    "cascade": "the stages of a search against exhaustive search",
    "graph": "the graph of neighbours of an archive made in the background",
    "ingest": "a folder stored over HTTP",
}


def benchmark_command(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="[DIR]",
            help="Folder of meshes with labels.csv, or with a folder a class. [default: made shapes]",
        ),
    ] = None,
    *,
    only: Annotated[
        list[Subject] | None, typer.Option(help="Measure only this subject; repeatable. [default: all]")
    ] = None,
    sizes: Annotated[
        list[int] | None,
        typer.Option(
            "--shapes",
            min=1,
            help="Shapes in the archive that is queried, about 42 kB of disk each; repeatable. "
            "[default: 380, 1000, 10000, 100000]",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Measure the time and memory of embedding and matching.

    The subjects are embedding, growth with size, matches, queries, the graph of neighbours and storing. Most
    figures are medians with quartiles. Shapes beyond the size of the collection are copies of its embeddings
    with noise. Measure on an idle machine, with OMP_NUM_THREADS=1.
    """
    subjects = list(dict.fromkeys(only or Subject))
    source = read_source(folder)
    with progress() as bar, TemporaryDirectory() as directory:
        scratch = Path(directory)

        def search() -> dict[str, Sequence[Any]]:
            rows, cascades = searching_rows(source, scratch, sizes=sizes or SIZES)
            return {"search": rows, "cascade": cascades}

        measures: dict[Subject, Callable[[], dict[str, Sequence[Any]]]] = {
            Subject.EMBEDDING: lambda: {"embedding": embedding_rows(source)},
            Subject.GROWTH: lambda: {"growth": growth_rows(source, scratch)},
            Subject.MATCH: lambda: {"match": matching_rows(source)},
            Subject.SEARCH: search,
            Subject.GRAPH: lambda: {"graph": graph_rows(source, scratch)},
            Subject.INGEST: lambda: {"ingest": ingesting_rows(source, scratch)},
        }
        task = bar.add_task("measuring", total=len(subjects))
        tables: dict[str, Sequence[Any]] = {}
        for subject in subjects:
            tables |= measures[subject]()
            bar.advance(task)
    if as_json:
        typer.echo(json.dumps(tables, default=vars))
        return
    for name, rows in tables.items():
        if rows:
            headings = [heading.replace("_", " ") for heading in rows[0]]
            print_table(TITLES[name], headings, [list(map(cell_of, row.values())) for row in rows])
    if "growth" in tables:
        seconds, memory = growth_exponents(tables["growth"])
        typer.echo(f"Growth: seconds as vertices^{seconds:.2f}, peak memory as vertices^{memory:.2f}.")


def cell_of(value: object) -> str:
    """Return a value of a benchmark as the cell of a table."""
    match value:
        case None:
            return "all"
        case bool():
            return "yes" if value else "no"
        case float():
            return digits(value)
        case int():
            return f"{value:,}"
        case dict():
            return ", ".join(f"{name} {cell_of(part)}" for name, part in value.items())
        case _:
            return str(value)
