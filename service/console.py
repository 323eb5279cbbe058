"""The output of commands: results on standard output, messages on standard error."""

from collections.abc import Callable, Collection, Sequence
from typing import TYPE_CHECKING, NoReturn

import typer

# rich is imported where a table or a bar is drawn: messages and JSON do not wait for it.
if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table


WIDTH = 10_000
"""Characters of a line of a file or a pipe, so that a row of a table is one line."""


def output() -> "Console":
    """Return the present standard output. Names of files and classes are never read as markup."""
    console = _console(stderr=False)
    if not console.is_terminal:
        console.width = WIDTH
    return console


def messages() -> "Console":
    """Return the present standard error, without markup too."""
    return _console(stderr=True)


def _console(*, stderr: bool) -> "Console":
    from rich.console import Console  # noqa: PLC0415

    return Console(stderr=stderr, markup=False, emoji=False, highlight=False)


def say(message: str) -> None:
    """Print one line on standard error."""
    typer.echo(message, err=True)


def count_of(number: int, noun: str) -> str:
    """Return a number and a noun, as "1 shape" or "2 shapes"."""
    return f"{number} {noun if number == 1 else f'{noun}s'}"


def fail(message: str, status: int = 1) -> NoReturn:
    """Print one line on standard error and exit: status 1 for a failure, 2 for a wrong call."""
    say(f"isoshape: {' '.join(message.split())}")
    raise typer.Exit(status)


def print_table(
    title: str, headings: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1, last: int = 0
) -> None:
    """Print a table: `left` columns of text, then numbers; the `last` rows, such as sums, below a rule."""
    texts, numbers = headings[:left], headings[left:]
    made = table(*texts, *(f">{heading}" for heading in numbers), fold=headings, title=title)
    for index, row in enumerate(rows):
        made.add_row(*row, end_section=last > 0 and index == len(rows) - last - 1)
    output().print(made)


def progress() -> "Progress":
    """Return a progress bar on standard error, removed at its end; invisible unless that is a terminal."""
    from rich.progress import (  # noqa: PLC0415
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = messages()
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


def counted(bar: "Progress", description: str, total: int) -> Callable[[int], None]:
    """Add a task to a progress bar, and return a function that advances it by a number of steps."""
    task = bar.add_task(description, total=total)
    return lambda count: bar.advance(task, count)


def table(*columns: str, fold: Collection[str] = (), title: str | None = None) -> "Table":
    """Return an empty table with a line under its head.

    A head that begins with ">" is of numbers, to the right. `fold` has the heads of columns whose text takes
    several lines where the terminal is too narrow; other columns stay on one line.
    """
    from rich import box  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    made = Table(box=box.SIMPLE_HEAD, collapse_padding=True, title=title)
    for column in columns:
        head, is_number = column.removeprefix(">"), column.startswith(">")
        overflow = {"overflow": "fold"} if head in fold else {"no_wrap": True}
        made.add_column(head, justify="right" if is_number else "left", **overflow)
    return made
