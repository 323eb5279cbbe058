"""`isoshape backup`: the archive copied into one file."""

from pathlib import Path
from typing import Annotated

import typer

from service.cli.archive import archive_in_use, print_counts
from service.storage.backup import back_up


def command(
    file: Annotated[Path, typer.Argument(help="The file to write.")],
    *,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it is there.")] = False,
) -> None:
    """Copy the archive of ISOSHAPE_DATABASE_URL into a file, while services use it.

    The copy is checked as `isoshape check` does before it has its name.
    """
    print_counts(back_up(archive_in_use(), file, replace=force))
