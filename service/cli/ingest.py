"""`isoshape ingest`: store many files."""

from pathlib import Path
from typing import Annotated

import typer

from core.io import READABLE
from service.cli.bulk import is_archive, store_archive
from service.cli.metadata import About, read_metadata, row_of
from service.cli.target import Collection, Key, Url, service_at
from service.client.concurrent_uploads import AT_ONCE, Item, upload_all
from service.console import fail, output, progress, say
from service.datasets import MeshFile, find_meshes
from service.shapes.fields import TAG_CHARACTERS


def command(
    paths: Annotated[
        list[Path], typer.Argument(metavar="PATH...", help="Mesh files, folders of them, and archives.")
    ],
    *,
    tag: Annotated[list[str] | None, typer.Option(help="Give every file this tag too; repeatable.")] = None,
    metadata: Annotated[
        Path | None,
        typer.Option(
            help="CSV file: the column name tells the file, tags its tags, and the others metadata."
        ),
    ] = None,
    url: Url = None,
    key: Key = None,
    collection: Collection = None,
    at_once: Annotated[int, typer.Option(min=1, max=64, help="Uploads under way at a time.")] = AT_ONCE,
) -> None:
    """Store mesh files under their own names. A file's class becomes a tag.

    The class is the one that labels.csv (columns file and class) in the file's folder gives, or else the name
    of the class folder, directly below the folder given; a file given itself has none but that of labels.csv.
    What is there already, the same bytes under the same name, stays as it is: the command may be run again. A
    file that is refused does not stop the others. An archive (zip, tar, tar.gz, tar.bz2, tar.xz) is sent as
    it is, and unpacked by the service; files in it have no class, and no row of the metadata.
    """
    archives = [path for path in paths if is_archive(path)]
    found = find_meshes([path for path in paths if path not in archives])
    if not found.files and not archives:
        fail(f"no meshes there; the formats read are {', '.join(READABLE)}")
    rows = {} if metadata is None else read_metadata(metadata)
    named = {file.path: row_of(rows, file.path) for file in found.files}
    items = [_item(file, rows.get(named[file.path] or "", About()), tag or []) for file in found.files]
    stray = sorted(set(rows) - set(named.values()))
    if stray:
        say(f"{metadata}: no file has the name {', '.join(stray)}")
    created = present = 0
    refused: list[tuple[str, str]] = []
    warnings: list[tuple[str, str]] = []
    with service_at(url, key, collection) as client, progress() as bar:
        task = bar.add_task("storing", total=len(items))
        for item, outcome in upload_all(client, items, at_once):
            if isinstance(outcome, str):
                refused.append((item.origin, outcome))
            elif outcome.created:
                created += 1
                warnings += [(item.origin, warning) for warning in outcome.shape.warnings]
            else:
                present += 1
            bar.advance(task)
        for path in archives:
            done = store_archive(client, path, tag or [], bar)
            created += done.stored
            present += done.present
            refused += done.refused
    left_out = f", {found.ignored} of other formats left out" if found.ignored else ""
    output().print(
        f"{created} stored, {present} already there, {len(refused)} refused{left_out}", soft_wrap=True
    )
    for origin, cause in sorted(warnings) + sorted(refused):
        say(f"{origin}: {cause}")
    if refused:
        raise typer.Exit(1)


def class_tag(label: str) -> str:
    """The class as a tag, which can hold no comma and must not be long."""
    return " ".join(label.replace(",", " ").split())[:TAG_CHARACTERS].strip()


def _item(file: MeshFile, about: About, more: list[str]) -> Item:
    own = [] if file.label is None else [class_tag(file.label)]
    return Item(file.path.name, file.path, (*filter(None, own), *about.tags, *more), about.metadata)
