"""`isoshape query`: the stored shapes most like a file."""

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from service.cli.console import output, say
from service.cli.target import Key, Url, service_at
from service.search.ranking import RankBy
from service.search.schemas import QueryAnswer


def command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A mesh file.")],
    *,
    top_k: Annotated[int, typer.Option(min=1, max=100, help="Results at most.")] = 3,
    rank_by: Annotated[RankBy, typer.Option(help="What they are sorted by.")] = "cc",
    partial: Annotated[
        bool, typer.Option("--partial", help="The file is a part: find what it is a part of.")
    ] = False,
    tag: Annotated[
        list[str] | None, typer.Option(help="Only among shapes with this tag; repeatable.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the service's answer as it is.")] = False,
    url: Url = None,
    key: Key = None,
) -> None:
    """Find the stored shapes most like a mesh file."""
    mesh = (file.name, file.read_bytes())
    with service_at(url, key) as client:
        answer = client.query_file(mesh, top_k=top_k, rank_by=rank_by, partial=partial, filter=tag or [])
    if as_json:
        typer.echo(answer.model_dump_json(exclude_none=True))
    else:
        print_answer(output(), answer)
        times = ", ".join(f"{stage} {time:.0f}" for stage, time in answer.milliseconds.items())
        for warning in answer.warnings:
            say(f"{file}: {warning}")
        say(f"{answer.compared} of {answer.stored} stored shapes compared; milliseconds: {times}")


def print_answer(console: Console, answer: QueryAnswer) -> None:
    """The results as a table."""
    if not answer.results:
        console.print("nothing is stored that could be compared")
        return
    table = Table(box=box.SIMPLE_HEAD, collapse_padding=True)
    table.add_column("rank", justify="right")
    table.add_column("name", overflow="fold")
    table.add_column("tags", overflow="fold")
    for name in ("cc", "ssd", "sim", "combined"):
        table.add_column(name, justify="right", no_wrap=True)
    partial = any(result.part_distance is not None for result in answer.results)
    if partial:
        table.add_column("part distance", justify="right", no_wrap=True)
    for result in answer.results:
        told = [] if result.part_distance is None else [f"{result.part_distance:.4f}"]
        table.add_row(
            str(result.rank),
            result.shape.name,
            ", ".join(result.shape.tags),
            f"{result.cc:.4f}",
            f"{result.ssd:.4f}",
            f"{result.sim:.4f}",
            f"{result.combined:.3f}",
            *told,
        )
    console.print(table)
    if not (answer.matched or partial):
        console.print("Not even the first is like it: its cc is below the pipeline's threshold.")
