"""Folders of meshes on disk, with the class of each mesh if the folder defines it.

Two layouts have classes. A folder with `labels.csv` (columns `file` and `class`, paths relative to the
folder) holds the listed files only. Otherwise each folder directly below the given folder is a class, with
all files beneath it.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from core.io import by_ending, readable
from service.errors import ExpectedError

LABELS_FILE = "labels.csv"


class DatasetError(ExpectedError):
    """A folder or its labels cannot be read; the message gives the place and the reason."""


@dataclass(frozen=True)
class MeshFile:
    """A file on disk, its class if it has one, and the template of `labels.csv`, by default the class."""

    path: Path
    label: str | None
    template: str | None = None


@dataclass(frozen=True)
class FoundMeshes:
    """The meshes under some paths, sorted by folder, then in the order of `labels.csv` or by name.

    `ignored` is the number of files whose ending names no format that is read.
    """

    files: tuple[MeshFile, ...]
    ignored: int


def find_meshes(paths: Sequence[Path]) -> FoundMeshes:
    """Find all meshes under the paths: the given files, and all files beneath the given folders.

    A given or listed file is included with any ending, even if it does not exist: reading it gives the error.
    Files directly in a given folder have no class; files further down have the class folder's name.
    `labels.csv` takes precedence over both. A given file has the class of `labels.csv` beside it, or none.
    Raise DatasetError if a path does not exist, a folder cannot be listed, or a `labels.csv` cannot be used.
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
            found = FoundMeshes((MeshFile(path, beside[path.parent].get(path.resolve())),), 0)
        else:
            raise DatasetError(f"{path}: there is no such file or folder")
        ignored += found.ignored
        for file in found.files:
            files.setdefault(file.path.resolve(), file)
    return FoundMeshes(tuple(files.values()), ignored)


def read_collection(folder: Path) -> list[tuple[Path, str]]:
    """Return the meshes of a labelled folder, each with its class.

    Raise DatasetError if the path is not a folder, holds no mesh, or holds a mesh without a class.
    """
    if not folder.is_dir():
        raise DatasetError(f"{folder}: there is no such folder")
    files = find_meshes([folder]).files
    if not files:
        raise DatasetError(f"{folder}: no meshes; the formats read are {', '.join(sorted(readable()))}")
    labelled = [(file.path, file.label) for file in files if file.label is not None]
    if len(labelled) < len(files):
        stray = next(file.path for file in files if file.label is None)
        raise DatasetError(
            f"{stray} has no class; a collection is a folder with {LABELS_FILE} (file,class) "
            "or a folder of class folders"
        )
    return labelled


def _scan(folder: Path, label: str | None, above: frozenset[Path]) -> FoundMeshes:
    here = above | {folder.resolve()}
    labels = folder / LABELS_FILE
    if labels.is_file():
        return FoundMeshes(tuple(read_labels(labels)), 0)
    try:
        entries = sorted(entry for entry in folder.iterdir() if not entry.name.startswith("."))
    except OSError as error:
        raise DatasetError(f"{folder}: {error.strerror}") from error
    files: list[MeshFile] = []
    ignored = 0
    for entry in entries:
        if entry.is_dir():
            if entry.resolve() in here:  # a link to a folder above leads into a loop
                continue
            found = _scan(entry, label or entry.name, here)
            files.extend(found.files)
            ignored += found.ignored
        elif by_ending(entry.suffix.lstrip(".")) is not None:
            files.append(MeshFile(entry, label))
        else:
            ignored += 1
    return FoundMeshes(tuple(files), ignored)


def _labels_in(folder: Path) -> dict[Path, str | None]:
    labels = folder / LABELS_FILE
    if not labels.is_file():
        return {}
    return {file.path.resolve(): file.label for file in read_labels(labels)}


def read_labels(labels: Path) -> list[MeshFile]:
    """Return the files of a `labels.csv`, which are not looked for.

    Raise DatasetError if the file cannot be read, lacks a column, or has a row without a file or a class, or
    a file twice.
    """
    columns, rows = read_table(labels)
    if not {"file", "class"} <= set(columns):
        raise DatasetError(f"{labels}: the first line must name the columns file and class")
    files: dict[Path, MeshFile] = {}
    for line, row in rows:
        name, label = (row["file"] or "").strip(), (row["class"] or "").strip()
        if not name or not label:
            raise DatasetError(f"{labels}, line {line}: a file and a class are needed")
        path = labels.parent / name
        if path in files:
            raise DatasetError(f"{labels}: {path.name} is listed twice")
        files[path] = MeshFile(path, label, (row.get("template") or "").strip() or label)
    return list(files.values())


def read_table(path: Path) -> tuple[list[str], list[tuple[int, dict[str, str | None]]]]:
    """Return the columns of a CSV file, and the rows with the numbers of their lines.

    A missing cell is None, and cells without a column have the key None. Raise DatasetError if the file
    cannot be read, or is no CSV.
    """
    try:
        # Spreadsheets write a byte order mark, which would otherwise begin the name of the first column.
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.DictReader(stream, skipinitialspace=True, strict=True)
            rows = [(reader.line_num, row) for row in reader]
            return list(reader.fieldnames or ()), rows
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DatasetError(f"{path}: {error}") from error
