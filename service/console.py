"""What every command prints with: results on standard output, everything else on standard error."""

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
    """Standard output as it is now; names of files and classes are printed as they are, never as markup."""
    return Console(markup=False, highlight=False)


def messages() -> Console:
    """Standard error, likewise."""
    return Console(stderr=True, markup=False, highlight=False)


def say(message: str) -> None:
    """Print one line on standard error."""
    messages().print(message, soft_wrap=True)


def fail(message: str, status: int = 1) -> NoReturn:
    """Print one line on standard error and end with the status: 1 it did not work, 2 it was asked wrongly."""
    say(f"isoshape: {' '.join(message.split())}")
    raise typer.Exit(status)


def progress() -> Progress:
    """A progress bar on standard error, gone when done; nothing where that is no terminal."""
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
