"""`isoshape ingest`: store many files."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from core.io import readable
from service.cli.archive_upload import is_archive, store_archive
from service.cli.ingest_tally import Tally
from service.cli.metadata import About, read_metadata, row_of
from service.cli.service_address import Collection, Key, Url, service_at
from service.client.concurrent_uploads import AT_ONCE, Item, upload_all
from service.console import fail, progress, say
from service.datasets import MeshFile, find_meshes
from service.shapes.fields import TAG_CHARACTERS


def command(
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
    Ctrl-C. A refused file does not stop the others. The service unpacks archives (zip, tar, tar.gz, tar.bz2,
    tar.xz); their files have no class and no metadata, and are not split.

    With --split parts, the parts of a STEP or 3MF have the metadata assembly, assembly_path and instances.
    """
    archives = [path for path in paths if is_archive(path)]
    if split is not None and archives:
        fail("the files of an archive cannot be split; unpack it first")
    found = find_meshes([path for path in paths if path not in archives])
    if not found.files and not archives:
        fail(f"no meshes found; the formats read are {', '.join(readable())}")
    rows = {} if metadata is None else read_metadata(metadata)
    named = {file.path: row_of(rows, file.path) for file in found.files}
    items = [_item(file, rows.get(named[file.path] or "", About()), tag or [], split) for file in found.files]
    stray = sorted(set(rows) - set(named.values()))
    if stray:
        say(f"{metadata}: no file has the name {', '.join(stray)}")
    tally = Tally(len(items) + len(archives), found.ignored)
    stopped = False
    try:
        with service_at(url, key, collection, new=True) as client, progress() as bar:
            task = bar.add_task("storing", total=len(items))
            for item, outcome in upload_all(client, items, at_once):
                tally.add(item, outcome)
                bar.update(task, description=f"storing {item.name}", advance=1)
                tally.say_now_and_then(visible=bar.disable)
            for path in archives:
                tally.add_archive(store_archive(client, path, tag or [], bar))
    except KeyboardInterrupt:
        stopped = True
    tally.print()
    if stopped:
        fail(f"stopped; {tally.left} of {tally.total} left, and the same command continues", status=130)
    if tally.refused:
        raise typer.Exit(1)


def class_tag(label: str) -> str:
    """The class as a tag, which can hold no comma and must not be long."""
    return " ".join(label.replace(",", " ").split())[:TAG_CHARACTERS].strip()


def _item(file: MeshFile, about: About, more: list[str], split: Literal["parts"] | None) -> Item:
    own = [] if file.label is None else [class_tag(file.label)]
    return Item(file.path.name, file.path, (*filter(None, own), *about.tags, *more), about.metadata, split)
