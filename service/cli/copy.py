"""`isoshape copy`: an archive between an SQLite file and PostgreSQL."""

from contextlib import closing
from typing import Annotated

import typer
from rich.progress import TaskID

from service.cli.local_service import database_named
from service.console import fail, output, progress
from service.settings import load_settings
from service.storage.copying import copy_archive
from service.storage.database import Database
from service.storage.sqlite import path_of


def command(
    source: Annotated[str, typer.Argument(help="The archive to copy: a file or an SQLAlchemy URL.")],
    target: Annotated[str, typer.Argument(help="An empty database: a file or an SQLAlchemy URL.")],
) -> None:
    """Copy an archive between SQLite and PostgreSQL.

    The command compares every row of both. The copy is of one moment and lacks later changes of the source.
    Services that write to an SQLite source wait for the copy to end. A copy that is stopped or differs from
    the source leaves the target empty.
    """
    settings = load_settings()
    from_url, to_url = database_named("SOURCE", source), database_named("TARGET", target)
    if from_url.startswith("sqlite") and not path_of(from_url).is_file():
        fail(f"there is no archive at {path_of(from_url)}")
    if from_url == to_url:
        fail("an archive cannot be copied onto itself")
    with (
        closing(Database(from_url, lock_seconds=settings.lock_seconds)) as origin,
        closing(Database(to_url, lock_seconds=settings.lock_seconds)) as copy,
        progress() as bar,
    ):
        tasks: dict[str, TaskID] = {}

        def advance(table: str, done: int, total: int) -> None:
            if table not in tasks:
                tasks[table] = bar.add_task(table, total=total)
            bar.update(tasks[table], completed=done)

        copied = copy_archive(origin, copy, advance)
    output().print(
        f"{copied.shapes} shapes on {copied.blobs} files of {copied.bytes} bytes, {copied.embeddings} "
        "embeddings: copied, and compared row by row",
        soft_wrap=True,
    )
