"""A bulk upload: an archive is sent whole, and a job of the service stores its files."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.progress import Progress

from service.client import Client, ProblemError
from service.http.problem_document import TYPE_PREFIX, Problem
from service.jobs.schemas import Cause

ENDINGS = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tbz2", ".tar.xz", ".txz")


@dataclass(frozen=True)
class Done:
    """The numbers of files stored and already present, and the refused files with their causes."""

    stored: int
    present: int
    refused: list[tuple[str, str]]


def is_archive(path: Path) -> bool:
    """Whether a file is an archive, by its name."""
    return path.is_file() and path.name.lower().endswith(ENDINGS)


def store_archive(client: Client, path: Path, tags: Sequence[str], bar: Progress) -> Done:
    """Send an archive, and wait until its job has ended.

    Raises
    ------
    ClientError
        The service does not answer, or gives an unexpected answer.
    """
    task = bar.add_task(f"storing {path.name}", total=None)
    try:
        sent = client.send_archive(path, tags=tags)
    except ProblemError as error:
        return Done(0, 0, [(str(path), _said(error.problem))])
    except OSError as error:
        return Done(0, 0, [(str(path), error.strerror or str(error))])
    for job in client.follow_job(sent.id):
        counts = job.counts
        bar.update(task, total=counts.files or None, completed=counts.files - counts.waiting)
    refused = [
        (f"{path}: {file.path}", _said(file.problem))
        for file in client.job_files(sent.id, outcome="refused")
        if file.problem is not None
    ]
    if job.problem is not None:
        refused.append((str(path), _said(job.problem)))
    elif job.state == "cancelled":
        refused.append((str(path), "the job was cancelled"))
    return Done(job.counts.stored, job.counts.present, refused)


def _said(problem: Problem | Cause) -> str:
    return f"{problem.type.removeprefix(TYPE_PREFIX)}: {problem.detail}"
