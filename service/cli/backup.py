"""`isoshape backup`: a copy of the archive in one file."""

from pathlib import Path
from typing import Annotated

import typer

from service.cli.archive import archive_in_use, print_counts
from service.storage.backup import back_up


def command(
    file: Annotated[Path, typer.Argument(help="The file to write.")],
    *,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Copy the archive into a file while services use it.

    The archive is the database of ISOSHAPE_DATABASE_URL. The copy is checked as by `isoshape check` before it
    gets its name.
    """
    print_counts(back_up(archive_in_use(), file, replace=force))
