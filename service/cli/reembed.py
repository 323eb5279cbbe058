"""`isoshape reembed`: change the pipeline of an archive."""

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated

import typer

from core.parameters import Parameters
from service.compute.executor import start_executors
from service.compute.request_queue import RequestQueue
from service.console import fail, messages, output, progress, say
from service.observability import logging
from service.pipelines import repository
from service.server.process import sigterm_exits
from service.settings import Settings, load_parameters, load_settings
from service.shapes.reembedding import Reembedding, ReembeddingResult, prune_others
from service.storage.database import Database
from service.storage.migrate import migrate

# Where standard error is no terminal, which would show every state of a bar.
SECONDS_BETWEEN_LINES = 10.0

STOPPED = "stopped; the new embeddings are kept, and the same command continues"

Advance = Callable[[int, int], object]


def command(
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
    with sigterm_exits():
        try:
            outcome, pruned = reembed(settings, parameters, leave_out=leave_out, prune=prune)
        except KeyboardInterrupt:
            fail(STOPPED, status=130)
        except SystemExit:
            say(STOPPED)
            raise
    output().print(_told(outcome, parameters, pruned), soft_wrap=True)
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
    database = Database(settings.database_url, lock_seconds=settings.lock_seconds)
    try:
        migrate(database)
        if _is_done(database, parameters):
            outcome = ReembeddingResult(active=True)
        else:
            with _working(settings, parameters) as work, _shown() as advance:
                outcome = asyncio.run(
                    Reembedding(database, work, parameters).run(
                        at_once=settings.workers + 1, leave_out=leave_out, advance=advance
                    )
                )
        pruned = prune_others(database, parameters.fingerprint) if prune and outcome.active else 0
        return outcome, pruned
    finally:
        database.close()


def bring_up(settings: Settings) -> None:
    """Change an archive to the pipeline of the settings, unless it has that pipeline."""
    parameters = load_parameters(settings.pipeline)
    database = Database(settings.database_url, lock_seconds=settings.lock_seconds)
    try:
        migrate(database)
        with database.read() as session:
            active = repository.active(session)
    finally:
        database.close()
    if active not in {None, parameters.fingerprint}:
        say("embedding the stored shapes again, by another pipeline")
        reembed(settings, parameters, leave_out=True, prune=True)


def _is_done(database: Database, parameters: Parameters) -> bool:
    """Whether the pipeline is active and has embedded every file, so that no workers are needed."""
    with database.read() as session:
        active = repository.active(session) == parameters.fingerprint
        return active and not repository.unembedded(session, parameters.fingerprint)


@contextmanager
def _working(settings: Settings, parameters: Parameters) -> Iterator[RequestQueue]:
    """Worker processes for this command."""
    workers, readers = start_executors(settings, parameters)
    try:
        yield RequestQueue(
            workers,
            readers,
            settings.limits,
            read_seconds=settings.read_seconds,
            workers=settings.workers,
            waiting=0,
        )
    finally:
        readers.kill()
        workers.kill()


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
