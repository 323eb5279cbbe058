"""The commands on archives: `isoshape check`, `backup`, `recover`, `copy` and `reembed`."""

import asyncio
import json
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import TaskID

from core.parameters import Parameters
from service.cli.service_address import database_named
from service.compute.request_queue import RequestQueue, start_executors
from service.console import count_of, fail, messages, output, progress, say
from service.observability import logging
from service.pipelines import repository
from service.server.process import sigterm_exits
from service.settings import Settings, load_parameters, load_settings
from service.shapes.reembedding import Reembedding, ReembeddingResult, prune_others
from service.storage.backup import back_up, restore
from service.storage.checking import CheckReport, check
from service.storage.copying import copy_archive
from service.storage.database import Database, migrate
from service.storage.sqlite import path_of


def archive_in_use() -> Path:
    """Return the file that ISOSHAPE_DATABASE_URL names, or the default file."""
    return path_of(load_settings().database_url)


def print_counts(report: CheckReport) -> None:
    """Print the numbers of shapes, files and embeddings of an archive."""
    _print(_counts(report))
    for fingerprint, count in sorted(report.pipelines.items()):
        _print(f"pipeline {fingerprint}: {count_of(count, 'embedding')}")


def _counts(of: CheckReport) -> str:
    shapes, files = count_of(of.shapes, "shape"), count_of(of.blobs, "file")
    return f"{shapes} on {files} of {of.bytes} bytes, {count_of(of.embeddings, 'embedding')}"


def _print(line: str) -> None:
    output().print(line, soft_wrap=True)


def check_command(
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
        _print(json.dumps({"archive": str(path), **asdict(report)}))
    else:
        print_counts(report)
        for fault in report.faults:
            _print(fault)
    if report.faults:
        say(f"isoshape: {len(report.faults)} faults in {path}")
        raise typer.Exit(1)


def backup_command(
    file: Annotated[Path, typer.Argument(help="The file to write.")],
    *,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Copy the archive into a file while services use it.

    The archive is the database of ISOSHAPE_DATABASE_URL. The copy is checked as by `isoshape check` before it
    gets its name.
    """
    print_counts(back_up(archive_in_use(), file, replace=force))


def recover_command(
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


def copy_command(
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
    _print(f"{_counts(copied)}: copied, and compared row by row")


# Where standard error is no terminal, which would show every state of a bar.
SECONDS_BETWEEN_LINES = 10.0

STOPPED = "stopped; the new embeddings are kept, and the same command continues"

Advance = Callable[[int, int], object]


def reembed_command(
    *,
    prune: Annotated[
        bool, typer.Option("--prune", help="Delete the embeddings of all other pipelines afterwards.")
    ] = False,
    leave_out: Annotated[
        bool,
        typer.Option(
            "--leave-out",
            help="Change the pipeline although some files cannot be embedded; no query finds those.",
        ),
    ] = False,
) -> None:
    """Embed every stored shape by another pipeline.

    ISOSHAPE_PIPELINE names the pipeline, ISOSHAPE_DATABASE_URL the database. A service may use the archive at
    the same time: queries use the old embeddings until every shape has a new one. The command can be stopped
    at any time, and continues from there when it is run again.
    """
    settings = load_settings()
    parameters = load_parameters(settings.pipeline)
    logging.configure("error" if "log_level" not in settings.model_fields_set else settings.log_level)
    try:
        with sigterm_exits():
            outcome, pruned = reembed(settings, parameters, leave_out=leave_out, prune=prune)
    except KeyboardInterrupt:
        fail(STOPPED, status=130)
    except SystemExit:
        say(STOPPED)
        raise
    _print(_told(outcome, parameters, pruned))
    for name, cause in outcome.refused:
        say(f"{name}: {cause}")
    if outcome.refused and not outcome.active:
        fail(
            "the archive keeps its pipeline, because these shapes have no new embedding: delete them, or "
            "leave them out with --leave-out"
        )


def reembed(
    settings: Settings, parameters: Parameters, *, leave_out: bool = False, prune: bool = False
) -> tuple[ReembeddingResult, int]:
    """Change the pipeline of an archive; return the result and the number of embeddings pruned."""
    with _migrated(settings) as database:
        with database.read() as session:
            is_done = repository.active(session) == parameters.fingerprint
            is_done = is_done and not repository.unembedded(session, parameters.fingerprint)
        # No workers are needed if every file is embedded.
        outcome = (
            ReembeddingResult(active=True)
            if is_done
            else _reembedded(database, settings, parameters, leave_out=leave_out)
        )
        pruned = prune_others(database, parameters.fingerprint) if prune and outcome.active else 0
        return outcome, pruned


def _reembedded(
    database: Database, settings: Settings, parameters: Parameters, *, leave_out: bool
) -> ReembeddingResult:
    """Embed what the pipeline has not embedded, by worker processes for this command."""
    workers, readers = start_executors(settings, parameters)
    queue = RequestQueue(workers, readers, settings.limits, settings.read_seconds, settings.workers)
    try:
        with _shown() as advance:
            work = Reembedding(database, queue, parameters)
            at_once = settings.workers + 1
            return asyncio.run(work.run(at_once=at_once, leave_out=leave_out, advance=advance))
    finally:
        readers.kill()
        workers.kill()


def bring_up(settings: Settings) -> None:
    """Change an archive to the pipeline of the settings, unless it has that pipeline."""
    parameters = load_parameters(settings.pipeline)
    with _migrated(settings) as database, database.read() as session:
        active = repository.active(session)
    if active not in {None, parameters.fingerprint}:
        say("embedding the stored shapes again, by another pipeline")
        reembed(settings, parameters, leave_out=True, prune=True)


@contextmanager
def _migrated(settings: Settings) -> Iterator[Database]:
    """Yield the database of the settings, with all tables."""
    with closing(Database(settings.database_url, lock_seconds=settings.lock_seconds)) as database:
        migrate(database)
        yield database


@contextmanager
def _shown() -> Iterator[Advance]:
    """Show the progress: a bar, or a line every few seconds."""
    if messages().is_terminal:
        with progress() as bar:
            task = bar.add_task("embedding", total=None)
            yield lambda done, total: bar.update(task, completed=done, total=total)
        return
    last = 0.0

    def line(done: int, total: int) -> None:
        nonlocal last
        if time.monotonic() - last > SECONDS_BETWEEN_LINES or done == total:
            last = time.monotonic()
            say(f"{done} of {total} embedded")

    yield line


def _told(outcome: ReembeddingResult, parameters: Parameters, pruned: int) -> str:
    named = f"pipeline {parameters.name} ({parameters.fingerprint})"
    if outcome.active and not (outcome.made or outcome.changed or outcome.refused or pruned):
        return f"nothing to do: {named} is active and has embedded every stored shape"
    parts = [f"{outcome.made} embedded by {named}"]
    if outcome.refused:
        parts.append(f"{len(outcome.refused)} cannot be")
    if outcome.active:
        parts.append("the archive is searched by it")
    if pruned:
        parts.append(f"{pruned} embeddings of other pipelines deleted")
    return ", ".join(parts)
