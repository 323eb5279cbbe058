"""Folders of meshes on disk, with the class of each where the folder says so.

Two layouts carry classes: a folder with `labels.csv` (columns `file` and `class`; files relative to the
folder; what is not listed does not belong to it), wherever it lies; and a folder of class folders, each with
everything beneath it.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from core.io import ENDINGS, READABLE
from service.errors import ExpectedError

LABELS_FILE = "labels.csv"


class CollectionError(ExpectedError):
    """A folder, or its labels, cannot be read as a collection; the message says what and where."""


@dataclass(frozen=True)
class MeshFile:
    """A file on disk and its class, if it has one."""

    path: Path
    label: str | None


@dataclass(frozen=True)
class Found:
    """What lies under some paths.

    Attributes
    ----------
    files : tuple of MeshFile
        Sorted by folder, then as `labels.csv` lists them, or by name.
    ignored : int
        Files left out because their ending is not one of a format that is read.
    """

    files: tuple[MeshFile, ...]
    ignored: int


def find_meshes(paths: Sequence[Path]) -> Found:
    """All meshes that the paths name: files as they are, folders with everything beneath them.

    A file that is named, or listed in `labels.csv`, is taken whatever its ending and whether or not it
    exists: reading it will say what is wrong. Of a folder given, the files directly in it have no class, and
    those further down that of the folder directly in it, by its name; `labels.csv` goes before either. A file
    given has the class that `labels.csv` beside it gives, or none.

    Raises
    ------
    CollectionError
        A path does not exist, a folder cannot be listed, or a `labels.csv` cannot be used.
    """
    files: dict[Path, MeshFile] = {}
    ignored = 0
    beside: dict[Path, dict[Path, str | None]] = {}
    for path in paths:
        if path.is_dir():
            found = _scan(path, None, frozenset())
        elif path.exists():
            if path.parent not in beside:
                beside[path.parent] = _labels_in(path.parent)
            found = Found((MeshFile(path, beside[path.parent].get(path.resolve())),), 0)
        else:
            raise CollectionError(f"{path}: there is no such file or folder")
        ignored += found.ignored
        for file in found.files:
            files.setdefault(file.path.resolve(), file)
    return Found(tuple(files.values()), ignored)


def read_collection(folder: Path) -> list[tuple[Path, str]]:
    """The meshes of a labelled folder, each with its class.

    Raises
    ------
    CollectionError
        It is not a folder, holds no mesh, or some mesh has no class.
    """
    if not folder.is_dir():
        raise CollectionError(f"{folder}: there is no such folder")
    files = find_meshes([folder]).files
    if not files:
        raise CollectionError(f"{folder}: no meshes; the formats read are {', '.join(sorted(READABLE))}")
    labelled = [(file.path, file.label) for file in files if file.label is not None]
    if len(labelled) < len(files):
        stray = next(file.path for file in files if file.label is None)
        raise CollectionError(
            f"{stray} has no class; a collection is a folder with {LABELS_FILE} (file,class) "
            "or a folder of class folders"
        )
    return labelled


def _scan(folder: Path, label: str | None, above: frozenset[Path]) -> Found:
    here = above | {folder.resolve()}
    labels = folder / LABELS_FILE
    if labels.is_file():
        return Found(tuple(_read_labels(labels)), 0)
    try:
        entries = sorted(entry for entry in folder.iterdir() if not entry.name.startswith("."))
    except OSError as error:
        raise CollectionError(f"{folder}: {error.strerror}") from error
    files: list[MeshFile] = []
    ignored = 0
    for entry in entries:
        if entry.is_dir():
            if entry.resolve() in here:  # a link to a folder above would never end
                continue
            found = _scan(entry, label or entry.name, here)
            files.extend(found.files)
            ignored += found.ignored
        elif entry.suffix.lower().lstrip(".") in ENDINGS:
            files.append(MeshFile(entry, label))
        else:
            ignored += 1
    return Found(tuple(files), ignored)


def _labels_in(folder: Path) -> dict[Path, str | None]:
    labels = folder / LABELS_FILE
    if not labels.is_file():
        return {}
    return {file.path.resolve(): file.label for file in _read_labels(labels)}


def _read_labels(labels: Path) -> list[MeshFile]:
    try:
        # Spreadsheets write a byte order mark, which would become part of the first column's name.
        with labels.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.DictReader(stream, skipinitialspace=True)
            if not {"file", "class"} <= set(reader.fieldnames or ()):
                raise CollectionError(f"{labels}: the first line must name the columns file and class")
            files = [_read_row(labels, reader.line_num, row) for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CollectionError(f"{labels}: {error}") from error
    seen: set[Path] = set()
    for file in files:
        if file.path in seen:
            raise CollectionError(f"{labels}: {file.path.name} is listed twice")
        seen.add(file.path)
    return files


def _read_row(labels: Path, line: int, row: dict[str, str | None]) -> MeshFile:
    name, label = (row["file"] or "").strip(), (row["class"] or "").strip()
    if not name or not label:
        raise CollectionError(f"{labels}, line {line}: a file and a class are needed")
    return MeshFile(labels.parent / name, label)
