"""`isoshape ingest`: store files, folders of files and archives."""

import csv
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import typer
from pydantic import ValidationError
from rich.progress import Progress

from core.io import readable
from service.cli.service_address import Collection, Key, Url, service_at
from service.client import Client, ProblemError, Upload
from service.client.concurrent_uploads import AT_ONCE, Item, upload_all
from service.console import fail, output, progress, say
from service.datasets import DatasetError, MeshFile, find_meshes
from service.http.problem_document import TYPE_PREFIX, Cause, faults_of
from service.shapes.fields import TAG_CHARACTERS, split_tags
from service.shapes.schemas import ShapeFields


def is_archive(path: Path) -> bool:
    """Return whether a file is an archive, by its name."""
    return path.is_file() and path.suffix.lower() == ".zip"


NAME, TAGS = "name", "tags"


@dataclass(frozen=True)
class About:
    """The tags and the metadata of a mesh."""

    tags: tuple[str, ...] = ()
    metadata: dict[str, str] | None = None


def read_metadata(path: Path) -> dict[str, About]:
    """Return the rows of a CSV file by their column `name`.

    The column holds the name of a file, with folders before it where names are repeated. The column `tags` is
    split at commas and semicolons. Every other column is a key; its empty cells are left out. Values stay
    text: a part number may begin with a zero.

    Raises
    ------
    DatasetError
        The file cannot be read, has no column `name`, names a mesh twice, or holds a value that no shape may
        have.
    """
    try:
        # Spreadsheets write a byte order mark, which would become part of the first column's name.
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.DictReader(stream, skipinitialspace=True, strict=True)
            _check_columns(path, list(reader.fieldnames or ()))
            rows: dict[str, About] = {}
            for row in reader:
                name = (row[NAME] or "").strip().replace("\\", "/")
                if not name or name in rows:
                    fault = f"{name} is listed twice" if name else "no name"
                    raise DatasetError(f"{path}, line {reader.line_num}: {fault}")
                rows[name] = _about(path, reader.line_num, row)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DatasetError(f"{path}: {error}") from error
    return rows


def row_of(rows: dict[str, About], path: Path) -> str | None:
    """Return the name in the rows that fits a file, the longest if several fit."""
    parts = path.parts
    names = ("/".join(parts[start:]) for start in range(len(parts)))
    return next((name for name in names if name in rows), None)


def _check_columns(path: Path, columns: list[str]) -> None:
    if NAME not in columns:
        raise DatasetError(f"{path}: the first line must name the columns, {NAME} among them")
    if not all(columns) or len(set(columns)) < len(columns):
        raise DatasetError(f"{path}: a column has no name, or the name of another")


def _about(path: Path, line: int, row: dict[str, str | None]) -> About:
    if None in row or None in row.values():
        raise DatasetError(f"{path}, line {line}: not as many cells as there are columns")
    cells = {key: (cell or "").strip() for key, cell in row.items()}
    tags = split_tags([cells.pop(TAGS, "").replace(";", ",")])
    del cells[NAME]
    metadata = {key: cell for key, cell in cells.items() if cell}
    try:
        checked = ShapeFields.model_validate({"name": "any", "tags": tags, "metadata": metadata})
    except ValidationError as error:
        faults = "; ".join(f"{fault.field}: {fault.message}" for fault in faults_of(error.errors()))
        raise DatasetError(f"{path}, line {line}: {faults}") from error
    return About(tuple(checked.tags), metadata)


SECONDS_BETWEEN_LINES = 30.0
"""Seconds between two lines of progress, where standard error is no terminal that shows a bar."""


@dataclass
class Tally:
    """Numbers of files and archives by their outcomes.

    Attributes
    ----------
    total : int
        Files and archives to send.
    ignored : int
        Files of other formats.
    finished, created, present : int
        Files and archives that have an outcome, and shapes that were stored or there before.
    refused, warnings : list
        Files by their origin, each with the cause or the warning.
    """

    total: int
    ignored: int
    finished: int = 0
    created: int = 0
    present: int = 0
    refused: list[tuple[str, str]] = field(default_factory=list)
    warnings: list[tuple[str, str]] = field(default_factory=list)
    _said: float = field(default_factory=time.monotonic)

    @property
    def left(self) -> int:
        """The number of files and archives without an outcome."""
        return self.total - self.finished

    def add(self, item: Item, outcome: Upload | str) -> None:
        """Count the outcome of a file: the shapes of its upload, or the cause of its refusal."""
        self.finished += 1
        if isinstance(outcome, str):
            self.refused.append((item.origin, outcome))
        else:
            for upload in (outcome, *outcome.parts):
                if upload.created:
                    self.created += 1
                    self.warnings += [(item.origin, warning) for warning in upload.shape.warnings]
                else:
                    self.present += 1

    def say_now_and_then(self, *, visible: bool) -> None:
        """Print a line of progress, if it is `visible` and the last one is some time ago."""
        if visible and time.monotonic() > self._said + SECONDS_BETWEEN_LINES:
            self._said = time.monotonic()
            say(f"{self.finished} of {self.total} done, {len(self.refused)} refused")

    def print(self) -> None:
        """Print the summary, then each warning and each refusal with its file."""
        left_out = f", {self.ignored} of other formats left out" if self.ignored else ""
        counts = f"{self.created} stored, {self.present} already there, {len(self.refused)} refused"
        output().print(f"{counts}{left_out}", soft_wrap=True)
        for origin, cause in sorted(self.warnings) + sorted(self.refused):
            say(f"{origin}: {cause}")


def store_archive(client: Client, path: Path, tags: Sequence[str], bar: Progress, tally: Tally) -> None:
    """Send an archive, wait until its job has ended, and count the outcomes of its files.

    Raises
    ------
    ClientError
        The service does not answer, or gives an unexpected answer.
    """
    task = bar.add_task(f"storing {path.name}", total=None)
    tally.finished += 1
    try:
        sent = client.send_archive(path, tags=tags)
    except ProblemError as error:
        tally.refused.append((str(path), _said(error.problem)))
        return
    except OSError as error:
        tally.refused.append((str(path), error.strerror or str(error)))
        return
    for job in client.follow_job(sent.id):
        counts = job.counts
        bar.update(task, total=counts.files or None, completed=counts.files - counts.waiting)
    tally.created += job.counts.stored
    tally.present += job.counts.present
    for file in client.job_files(sent.id, outcome="refused"):
        if file.problem is not None:
            tally.refused.append((f"{path}: {file.path}", _said(file.problem)))
    if job.problem is not None:
        tally.refused.append((str(path), _said(job.problem)))
    elif job.state == "cancelled":
        tally.refused.append((str(path), "the job was cancelled"))


def _said(problem: Cause) -> str:
    return f"{problem.type.removeprefix(TYPE_PREFIX)}: {problem.detail}"


def ingest_command(
    paths: Annotated[
        list[Path], typer.Argument(metavar="PATH...", help="Mesh files, folders of mesh files, and archives.")
    ],
    *,
    tag: Annotated[list[str] | None, typer.Option(help="Add this tag to every file; repeatable.")] = None,
    metadata: Annotated[
        Path | None,
        typer.Option(
            help="CSV file: column name holds the file name, tags its tags, other columns metadata."
        ),
    ] = None,
    split: Annotated[
        Literal["parts"] | None,
        typer.Option(help="parts: store each distinct part of a STEP or 3MF as a shape too."),
    ] = None,
    url: Url = None,
    key: Key = None,
    collection: Collection = None,
    at_once: Annotated[int, typer.Option(min=1, max=64, help="Uploads at the same time.")] = AT_ONCE,
) -> None:
    """Store mesh files, folders of meshes and archives.

    Each shape has the name of its file, and the class of the file as a tag. The class comes from labels.csv
    (columns file and class) in the folder of the file, or else from the name of the class folder, directly
    below the given folder. A file given by itself has a class only from labels.csv.

    A file that is already stored under its name stays as it is, so the command can be repeated, also after
    Ctrl-C. A refused file does not stop the others. The service unpacks archives (zip); their files have no
    class and no metadata, and are not split.

    With --split parts, the parts of a STEP or 3MF have the metadata assembly, assembly_path and instances.
    """
    archives = [path for path in paths if is_archive(path)]
    if split is not None and archives:
        fail("the files of an archive cannot be split; unpack it first")
    meshes = find_meshes([path for path in paths if path not in archives])
    if not meshes.files and not archives:
        fail(f"no meshes found; the formats read are {', '.join(readable())}")
    rows = {} if metadata is None else read_metadata(metadata)
    named = {file.path: row_of(rows, file.path) for file in meshes.files}
    items = [
        _item(file, rows.get(named[file.path] or "", About()), tag or [], split) for file in meshes.files
    ]
    stray = sorted(set(rows) - set(named.values()))
    if stray:
        say(f"{metadata}: no file has the name {', '.join(stray)}")
    tally = Tally(len(items) + len(archives), meshes.ignored)
    stopped = False
    try:
        with service_at(url, key, collection, new=True) as client, progress() as bar:
            task = bar.add_task("storing", total=len(items))
            for item, outcome in upload_all(client, items, at_once):
                tally.add(item, outcome)
                bar.update(task, description=f"storing {item.name}", advance=1)
                tally.say_now_and_then(visible=bar.disable)
            for path in archives:
                store_archive(client, path, tag or [], bar, tally)
    except KeyboardInterrupt:
        stopped = True
    tally.print()
    if stopped:
        fail(f"stopped; {tally.left} of {tally.total} left, and the same command continues", status=130)
    if tally.refused:
        raise typer.Exit(1)


def class_tag(label: str) -> str:
    """Return the class as a tag, which can hold no comma and must not be long."""
    return " ".join(label.replace(",", " ").split())[:TAG_CHARACTERS].strip()


def _item(file: MeshFile, about: About, more: list[str], split: Literal["parts"] | None) -> Item:
    class_tags = [] if file.label is None else [class_tag(file.label)]
    return Item(
        file.path.name, file.path, (*filter(None, class_tags), *about.tags, *more), about.metadata, split
    )
