"""The output of commands: results on standard output, messages on standard error."""

from typing import NoReturn

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)


def output() -> Console:
    """Return the present standard output. Names of files and classes are never read as markup."""
    return Console(markup=False, highlight=False)


def messages() -> Console:
    """Return the present standard error, without markup too."""
    return Console(stderr=True, markup=False, highlight=False)


def say(message: str) -> None:
    """Print one line on standard error."""
    messages().print(message, soft_wrap=True)


def fail(message: str, status: int = 1) -> NoReturn:
    """Print one line on standard error and exit: status 1 for a failure, 2 for a wrong call."""
    say(f"isoshape: {' '.join(message.split())}")
    raise typer.Exit(status)


def progress() -> Progress:
    """Return a progress bar on standard error, removed at its end; invisible unless that is a terminal."""
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
