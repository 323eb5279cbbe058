"""`isoshape duplicates`: groups of near-identical stored shapes."""

from functools import partial
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from service.cli.service_address import Collection, Key, Url, service_at
from service.console import output, progress, say
from service.duplicates.schemas import DuplicatesAnswer
from service.search.score_words import score_in_words


def command(
    *,
    min_cc: Annotated[
        float | None, typer.Option(min=-1.0, max=1.0, help="Only pairs with at least this cc.")
    ] = None,
    max_residual: Annotated[
        float | None,
        typer.Option(help="Largest distance of two aligned surfaces, over the square root of the area."),
    ] = None,
    variants: Annotated[
        bool, typer.Option("--variants", help="Also join rigid copies but for a local difference.")
    ] = False,
    tag: Annotated[
        list[str] | None, typer.Option(help="Search only shapes with this tag; repeatable.")
    ] = None,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print one row for each shape, as CSV.")] = False,
    url: Url = None,
    key: Key = None,
    collection: Collection = None,
) -> None:
    """Find groups of near-identical stored shapes.

    Copies may be rotated, scaled, mirrored or remeshed.
    """
    with service_at(url, key, collection) as client:
        ask = partial(
            client.duplicates, min_cc=min_cc, max_residual=max_residual, variants=variants, tag=tag or []
        )
        answer = ask()
        with progress() as bar:
            total = answer.unjudged
            task = bar.add_task("judging", total=total, visible=bool(total))
            left = total + 1
            while 0 < answer.unjudged < left:
                left = answer.unjudged
                answer = ask()
                bar.update(task, completed=total - answer.unjudged)
    if answer.unjudged:
        say(f"{answer.unjudged} shapes cannot be judged now: the groups may be incomplete")
    if as_csv:
        typer.echo(answer.csv().replace("\r\n", "\n"), nl=False)
    else:
        _print(answer)
    found = sum(len(group) for group in answer.groups)
    say(f"{found} of {answer.shapes} shapes in {len(answer.groups)} groups; {answer.aligned} pairs aligned")


def _print(answer: DuplicatesAnswer) -> None:
    table = Table(box=box.SIMPLE_HEAD, collapse_padding=True)
    table.add_column("group", justify="right")
    table.add_column("name", overflow="fold")
    table.add_column("likeness")
    for name in ("scale", "cc", "residual"):
        table.add_column(name, justify="right", no_wrap=True)
    for number, group in enumerate(answer.groups, 1):
        for one in group:
            numbers = f"{one.scale:.4g}", score_in_words(one.cc), f"{one.residual:.4f}"
            table.add_row(str(number), one.shape.name, one.likeness, *numbers)
    output().print(table)
