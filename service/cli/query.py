"""`isoshape query`: the stored shapes most similar to a file."""

import csv
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.cli.file_queries import answers
from service.cli.model_options import with_options
from service.cli.service_address import Collection, Key, Url, service_at
from service.client import Client
from service.console import fail, output, progress, say, table
from service.datasets import find_meshes
from service.duplicates.schemas import without_formula
from service.search.schemas import (
    CC_OF_PAIRS,
    QueryAnswer,
    Result,
    SearchOptions,
    likeness_in_words,
    score_in_words,
)
from service.shapes.schemas import box_in_words, in_unit, number_in_words

if TYPE_CHECKING:
    from rich.console import Console

COLUMNS: dict[str, Callable[[Result], object]] = {
    "rank": lambda result: result.rank,
    "id": lambda result: result.shape.id,
    "name": lambda result: result.shape.name,
    "tags": lambda result: ", ".join(result.shape.tags),
    "likeness": lambda result: result.likeness,
    "instances": lambda result: result.instances and result.instances.text,
    "scale": lambda result: result.scale,
    "difference": lambda result: result.difference and result.difference.text,
    "cc": lambda result: result.cc,
    "ssd": lambda result: result.ssd,
    "sim": lambda result: result.sim,
    "combined": lambda result: result.combined,
    "part_distance": lambda result: result.part_distance,
    "size_ratio": lambda result: result.size_ratio,
    "unit": lambda result: result.shape.unit,
    "length": lambda result: result.shape.facts.bounding_box[0],
    "width": lambda result: result.shape.facts.bounding_box[1],
    "height": lambda result: result.shape.facts.bounding_box[2],
    "area": lambda result: result.shape.facts.area,
    "volume": lambda result: result.shape.facts.volume if result.shape.facts.closed else None,
}
"""The columns of a row after that of the file, which are those of the page."""

# Correspondences are asked for the page; the JSON leaves them out.
UNASKED = {name: {"__all__": {"correspondence"}} for name in ("results", "parts")}


@with_options(SearchOptions, without={"correspondences", "embedding"}, rank_by="combined")
def query_command(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A mesh file or, with --csv, a folder of them.")
    ],
    *,
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer of the service as JSON.")] = False,
    as_csv: Annotated[
        bool, typer.Option("--csv", help="Print a row for each result, of each file of a folder.")
    ] = False,
    html: Annotated[
        Path | None,
        typer.Option(help="Also write a page with pictures of corresponding points to this file."),
    ] = None,
    url: Url = None,
    key: Key = None,
    collection: Collection = None,
    options: dict[str, Any],
) -> None:
    """Find the stored shapes most similar to a mesh file."""
    if as_csv:
        if as_json or html is not None:
            fail("--csv takes neither --json nor --html", status=2)
        with service_at(url, key, collection) as client:
            _print_rows(client, file, options)
        return
    mesh = (file.name, file.read_bytes())
    with service_at(url, key, collection) as client:
        answer = client.query_file(mesh, **options, correspondences=html is not None)
        if html is not None:
            write_report(client, mesh, options, answer, html)
    if as_json:
        typer.echo(answer.model_dump_json(exclude_none=True, exclude=UNASKED))
    else:
        print_answer(output(), answer)
        times = ", ".join(f"{stage} {time:.0f}" for stage, time in answer.milliseconds.items())
        for warning in answer.warnings:
            say(f"{file}: {warning}")
        compared = f"{answer.compared} of {answer.stored} stored shapes compared"
        if answer.results:
            say(CC_OF_PAIRS)
        say(f"{compared}; sorted by {answer.ranked_by.replace('_', ' ')}; milliseconds: {times}")


def _print_rows(client: Client, path: Path, options: dict[str, Any]) -> None:
    """Print the results of a file, or of all meshes of a folder, as CSV, and tell of unusable files."""
    refused = 0
    rows = csv.writer(sys.stdout, lineterminator="\n")
    rows.writerow(["file", *COLUMNS])
    paths = [file.path for file in find_meshes([path]).files]
    for file, answer in answers(client, paths, **options):
        if isinstance(answer, str):
            refused += 1
            say(f"{file}: {answer}")
            continue
        for result in answer.found:
            cells = [str(file), *(value(result) for value in COLUMNS.values())]
            rows.writerow([without_formula(cell) if isinstance(cell, str) else cell for cell in cells])
        sys.stdout.flush()
    say(f"{len(paths) - refused} of {len(paths)} files queried")
    if refused:
        raise typer.Exit(1)


def write_report(
    client: Client, mesh: tuple[str, bytes], options: dict[str, Any], answer: QueryAnswer, path: Path
) -> None:
    """Write the page of an answer, in UTF-8 on every system."""
    # Here, so that a query without a page does not wait for the imports of drawing.
    from service.report import report  # noqa: PLC0415

    with progress() as bar:
        task = bar.add_task("drawing", total=len(answer.found))
        text = report(client, mesh, options, answer, lambda: bar.advance(task))
    path.write_bytes(text.encode())


def print_answer(console: "Console", answer: QueryAnswer) -> None:
    """Print the results as a table."""
    if not answer.compared:
        console.print("no stored shape could be compared")
        return
    if not answer.found:
        console.print("no compared shape has so high a cc")
        return
    partial = any(result.part_distance is not None for result in answer.results)
    scores = [">cc", ">ssd", ">sim", ">combined", *[">part distance"] * partial]
    columns = (">rank", "name", "likeness", *scores, "sides", ">size over query", "tags")
    results = table(*columns, fold=("likeness", "tags"))
    for result in answer.found:
        shape, ratio = result.shape, result.size_ratio
        part_distance = [] if result.part_distance is None else [f"{result.part_distance:.4f}"]
        results.add_row(
            str(result.rank),
            shape.name,
            likeness_in_words(result.likeness, result.scale, instances=result.instances),
            score_in_words(result.cc),
            f"{result.ssd:.4f}",
            f"{result.sim:.4f}",
            f"{result.combined:.3f}",
            *part_distance,
            in_unit(box_in_words(shape.facts), shape.unit),
            "" if ratio is None else number_in_words(ratio),
            ", ".join(shape.tags),
        )
    console.print(results)
    for result in answer.results:
        if result.difference is not None:
            line = f"{result.rank}. {result.shape.name}: {result.difference.text}"
            console.print(line, soft_wrap=True)
    if not (answer.matched or partial):
        console.print("No result is similar.")
