"""`isoshape restore`: a backup in the place of the archive."""

from pathlib import Path
from typing import Annotated

import typer

from service.cli.archive import archive_in_use, print_counts
from service.storage.backup import restore


def command(
    file: Annotated[Path, typer.Argument(help="A file that `isoshape backup` wrote.")],
    *,
    force: Annotated[
        bool, typer.Option("--force", help="Replace an archive that is not empty; its shapes are lost.")
    ] = False,
) -> None:
    """Replace the archive by a backup.

    The archive is the database of ISOSHAPE_DATABASE_URL; no service may use it. The backup is checked first,
    as by `isoshape check`.
    """
    print_counts(restore(file, archive_in_use(), replace=force))
