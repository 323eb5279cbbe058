"""`isoshape restore`: a backup made the archive."""

from pathlib import Path
from typing import Annotated

import typer

from service.cli.archive import archive_in_use, print_counts
from service.storage.backup import restore


def command(
    file: Annotated[Path, typer.Argument(help="What `isoshape backup` wrote.")],
    *,
    force: Annotated[
        bool, typer.Option("--force", help="Replace an archive that is not empty; it is gone then.")
    ] = False,
) -> None:
    """Put a backup in the place of the archive of ISOSHAPE_DATABASE_URL, which no service may be using.

    The backup is checked first, as `isoshape check` does.
    """
    print_counts(restore(file, archive_in_use(), replace=force))
