"""`isoshape ingest`: store files, folders of files and archives."""

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from hashlib import file_digest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, get_args

import typer
from pydantic import ValidationError

from core.io import readable
from core.ranking.likeness import Copy
from service.cli.file_queries import answers
from service.cli.service_address import Collection, Key, Url, service_at
from service.client import Client, ProblemError, Upload
from service.client.clients import AT_ONCE, Item, upload_all
from service.console import fail, output, progress, say
from service.datasets import DatasetError, MeshFile, find_meshes, read_table
from service.http.problem_document import TYPE_PREFIX, Cause, faults_of
from service.search.schemas import QueryAnswer, likeness_in_words
from service.shapes.fields import TAG_CHARACTERS, base_name, clean_name, split_tags
from service.shapes.schemas import ShapeFields

if TYPE_CHECKING:
    from rich.progress import Progress

About = tuple[tuple[str, ...], dict[str, str] | None]
"""The tags and the metadata of a mesh."""


def read_metadata(path: Path) -> dict[str, About]:
    """Return the rows of a CSV file by their column `name`.

    The column holds the name of a file, with folders before it where names are repeated. The column `tags` is
    split at commas and semicolons. Every other column is a key; its empty cells are left out. Values stay
    text: a part number may begin with a zero. Raise DatasetError if the file cannot be read, has no column
    `name`, names a mesh twice, or holds a value that no shape may have.
    """
    columns, lines = read_table(path)
    if "name" not in columns:
        raise DatasetError(f"{path}: the first line must name the columns, name among them")
    if not all(columns) or len(set(columns)) < len(columns):
        raise DatasetError(f"{path}: a column has no name, or the name of another")
    rows: dict[str, About] = {}
    for line, row in lines:
        try:
            _add_row(rows, row)
        except DatasetError as error:
            raise DatasetError(f"{path}, line {line}: {error}") from error
    return rows


def _add_row(rows: dict[str, About], row: dict[str, str | None]) -> None:
    cells = {key: (cell or "").strip() for key, cell in row.items() if key is not None}
    name = cells.pop("name").replace("\\", "/")
    if not name or name in rows:
        raise DatasetError(f"{name} is listed twice" if name else "no name")
    if None in row or None in row.values():
        raise DatasetError("not as many cells as there are columns")
    tags = split_tags([cells.pop("tags", "").replace(";", ",")])
    metadata = {key: cell for key, cell in cells.items() if cell}
    try:
        checked = ShapeFields.model_validate({"name": "any", "tags": tags, "metadata": metadata})
    except ValidationError as error:
        faults = (f"{fault.field}: {fault.message}" for fault in faults_of(error.errors()))
        raise DatasetError("; ".join(faults)) from error
    rows[name] = tuple(checked.tags), metadata


def row_of(rows: dict[str, About], path: Path) -> str | None:
    """Return the name in the rows that fits a file, the longest if several fit."""
    names = ("/".join(path.parts[start:]) for start in range(len(path.parts)))
    return next((name for name in names if name in rows), None)


LOOKED_AT = 5
"""The results of a search among which copies are looked for."""

ESCAPED = re.compile(r'[\x00-\x1a\x1c-\x1f"]')
"""The characters that HTTPX writes as %XX in the name of a file that it uploads."""

SECONDS_BETWEEN_LINES = 30.0
"""Seconds between two lines of progress, where standard error is no terminal that shows a bar."""


@dataclass
class Tally:
    """Numbers of files and archives by their outcomes.

    Of `total` files and archives to send, `finished` have an outcome: shapes `created`, or `present` before,
    `changed` of them with new tags or metadata, and `ignored` files are of other formats. `refused` and
    `warnings` name files by their origin.
    """

    total: int
    finished: int = 0
    created: int = 0
    present: int = 0
    changed: int = 0
    ignored: int = 0
    refused: list[tuple[str, str]] = field(default_factory=list)
    warnings: list[tuple[str, str]] = field(default_factory=list)
    _said: float = field(default_factory=time.monotonic)

    def add(self, item: Item, outcome: Upload | str) -> None:
        """Count the outcome of a file: the shapes of its upload, or the cause of its refusal."""
        self.finished += 1
        if isinstance(outcome, str):
            self.refused.append((item.origin, outcome))
            return
        for upload in (outcome, *outcome.parts):
            self.created += upload.created
            self.present += not upload.created
            self.changed += bool(upload.changed)
            if upload.created:
                self.warnings += [(item.origin, warning) for warning in upload.shape.warnings]

    def say_now_and_then(self) -> None:
        """Print a line of progress if the last one is some time ago."""
        if time.monotonic() > self._said + SECONDS_BETWEEN_LINES:
            self._said = time.monotonic()
            say(f"{self.finished} of {self.total} done, {len(self.refused)} refused")


def store_archive(client: Client, path: Path, tags: Sequence[str], bar: "Progress", tally: Tally) -> None:
    """Send an archive, wait until its job has ended, and count the outcomes of its files.

    Raise ClientError if the service does not answer, or gives an unexpected answer.
    """
    task = bar.add_task(f"storing {path.name}", total=None)
    tally.finished += 1
    try:
        sent = client.send_archive(path, tags=tags)
    except (ProblemError, OSError) as error:
        cause = _said(error.problem) if isinstance(error, ProblemError) else error.strerror or str(error)
        tally.refused.append((str(path), cause))
        return
    for job in client.follow_job(sent.id):
        counts = job.counts
        bar.update(task, total=counts.files or None, completed=counts.files - counts.waiting)
    tally.created += job.counts.stored
    tally.present += job.counts.present
    for file in client.job_files(sent.id, outcome="refused"):
        if file.problem is not None and file.problem.type == f"{TYPE_PREFIX}unknown-format":
            tally.ignored += 1
        elif file.problem is not None:
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
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Store nothing; tell which files are there already.")
    ] = False,
) -> None:
    """Store mesh files, folders of meshes and archives.

    Each shape has the name of its file, and the class of the file as a tag. The class comes from labels.csv
    (columns file and class) in the folder of the file, or else from the name of the class folder, directly
    below the given folder. A file given by itself has a class only from labels.csv.

    A file that is already stored under its name gets the new tags and metadata, so the command can be
    repeated, also after Ctrl-C. A refused file does not stop the others. The service unpacks archives (zip);
    their files have no class and no metadata, and are not split.

    With --split parts, the parts of a STEP or 3MF have the metadata assembly, assembly_path and instances.

    With --dry-run, each mesh is searched for instead. A stored rigid copy of it, or else a variant, is named:
    only the same file under its name is already there.
    """
    archives = [path for path in paths if path.is_file() and path.suffix.lower() == ".zip"]
    if split is not None and archives:
        fail("the files of an archive cannot be split; unpack it first")
    meshes = find_meshes([path for path in paths if path not in archives])
    if not meshes.files and not archives:
        fail(f"no meshes found; the formats read are {', '.join(readable())}")
    if dry_run:
        if archives:
            fail("the meshes of an archive are not searched for; unpack it first", status=2)
        with service_at(url, key, collection) as client:
            _look_up(client, [file.path for file in meshes.files])
        return
    rows = {} if metadata is None else read_metadata(metadata)
    named = {file.path: row_of(rows, file.path) for file in meshes.files}
    items = [
        _item(file, *rows.get(named[file.path] or "", ((), None)), tag or [], split) for file in meshes.files
    ]
    stray = sorted(set(rows) - set(named.values()))
    if stray:
        say(f"{metadata}: no file has the name {', '.join(stray)}")
    tally = Tally(len(items) + len(archives), ignored=meshes.ignored)
    stopped = False
    try:
        with service_at(url, key, collection, new=True) as client, progress() as bar:
            task = bar.add_task("storing", total=len(items))
            for item, outcome in upload_all(client, items, at_once):
                tally.add(item, outcome)
                bar.update(task, description=f"storing {item.name}", advance=1)
                if bar.disable:
                    tally.say_now_and_then()
            for path in archives:
                store_archive(client, path, tag or [], bar, tally)
    except KeyboardInterrupt:
        stopped = True
    left_out = f", {tally.ignored} of other formats left out" if tally.ignored else ""
    changed = f" ({tally.changed} with new tags or metadata)" if tally.changed else ""
    counts = f"{tally.created} stored, {tally.present} already there{changed}, {len(tally.refused)} refused"
    output().print(f"{counts}{left_out}", soft_wrap=True)
    for origin, cause in sorted(tally.warnings) + sorted(tally.refused):
        say(f"{origin}: {cause}")
    if stopped:
        left = tally.total - tally.finished
        fail(f"stopped; {left} of {tally.total} left, and the same command continues", status=130)
    if tally.refused:
        raise typer.Exit(1)


def _look_up(client: Client, paths: Sequence[Path]) -> None:
    """Print for each file whether it would be stored, and the stored shape that it copies."""
    counts = {"would be stored": 0, "already there": 0, "refused": 0}
    earlier: set[tuple[str, str]] = set()
    for path, answer in answers(client, paths, top_k=LOOKED_AT, rank_by="combined"):
        outcome, told = (
            ("refused", answer) if isinstance(answer, str) else _outcome(client, path, answer, earlier)
        )
        counts[outcome] += 1
        output().print(f"{path}: {outcome}{told and f'; {told}'}", soft_wrap=True)
    output().print(", ".join(f"{count} {outcome}" for outcome, count in counts.items()), soft_wrap=True)
    if counts["refused"]:
        raise typer.Exit(1)


def _outcome(
    client: Client, path: Path, answer: QueryAnswer, earlier: set[tuple[str, str]]
) -> tuple[str, str]:
    """Return what an ingest would do with a file, and which shape it copies.

    A file is there if a stored shape, or an `earlier` file, has its name and its bytes (SHA-256).
    """
    try:
        name = clean_name(ESCAPED.sub(lambda found: f"%{ord(found[0]):02X}", base_name(path.name)))
        with path.open("rb") as content:
            sha256 = file_digest(content, "sha256").hexdigest()
    except ValueError as error:
        return "refused", f"name: {error}"
    except OSError as error:
        return "refused", error.strerror or str(error)
    if (name, sha256) in earlier or any(shape.name == name for shape in client.shapes(sha256=sha256)):
        return "already there", ""
    earlier.add((name, sha256))
    return "would be stored", _copied(answer)


def _copied(answer: QueryAnswer) -> str:
    """Return the likeness and name of the nearest copy of a shape, or else variant; "" if there is none."""
    copies = {result.likeness: result for result in reversed(answer.results)}
    for likeness in get_args(Copy):
        if likeness in copies:
            result = copies[likeness]
            return f"{likeness_in_words(likeness, result.scale)}: {result.shape.name}"
    return ""


def class_tag(label: str) -> str:
    """Return the class as a tag: no comma, not long, and "?" for what is not UTF-8."""
    label = label.encode(errors="replace").decode()
    return " ".join(label.replace(",", " ").split())[:TAG_CHARACTERS].strip()


def _item(
    file: MeshFile,
    tags: Sequence[str],
    metadata: dict[str, str] | None,
    more: Sequence[str],
    split: Literal["parts"] | None,
) -> Item:
    tags = (*filter(None, [class_tag(file.label or "")]), *tags, *more)
    return Item(file.path.name, file.path, tags, metadata, split)
