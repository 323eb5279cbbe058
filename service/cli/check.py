"""`isoshape check`: whether an archive is intact."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from service.cli.archive import archive_in_use, print_counts
from service.console import output, say
from service.settings import load_settings
from service.storage.checking import check


def command(
    file: Annotated[
        Path | None,
        typer.Argument(help="An archive or a backup. [default: the database of ISOSHAPE_DATABASE_URL]"),
    ] = None,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON object.")] = False,
) -> None:
    """Check every file, reference and embedding of an archive.

    The check includes the SHA-256 of every file. A service may use the archive at the same time. The command
    names each fault and ends with status 1 if there is any.
    """
    path = file or archive_in_use()
    report = check(path, lock_seconds=load_settings().lock_seconds)
    if as_json:
        output().print(json.dumps({"archive": str(path), **asdict(report)}), soft_wrap=True)
    else:
        print_counts(report)
        for fault in report.faults:
            output().print(fault, soft_wrap=True)
    if report.faults:
        say(f"isoshape: {len(report.faults)} faults in {path}")
        raise typer.Exit(1)
