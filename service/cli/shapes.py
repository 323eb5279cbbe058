"""The commands on stored shapes: `isoshape list`, `show`, `tag`, `delete` and `restore`."""

import json
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from itertools import islice
from typing import Annotated, Any, TypeVar
from uuid import UUID

import typer
from pydantic import BaseModel, ValidationError

from service.cli.model_options import with_options
from service.cli.service_address import Collection, Key, Url, service_at
from service.client import Client, ClientError, ProblemError
from service.console import count_of, fail, output, say, table
from service.http.problem_document import faults_of
from service.shapes.bulk_schemas import BulkChange
from service.shapes.fields import split_tags
from service.shapes.records import Sort
from service.shapes.schemas import (
    DeletedShape,
    FileAndFields,
    Filters,
    Shape,
    box_in_words,
    in_unit,
    number_in_words,
    volume_in_words,
)

Stored = TypeVar("Stored", bound=FileAndFields)

Names = Annotated[list[str], typer.Argument(metavar="SHAPE...", help="Ids of shapes, or their names.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object a line.")]


@with_options(Filters)
def list_command(
    *,
    sort: Annotated[
        Sort, typer.Option(help="The best match of --q first, the oldest or the newest first, or by name.")
    ] = "relevance",
    limit: Annotated[int, typer.Option(min=0, help="The largest number of shapes; 0 is no limit.")] = 50,
    deleted: Annotated[
        bool, typer.Option("--deleted", help="List deleted shapes that can be restored, without filters.")
    ] = False,
    as_json: AsJson = False,
    url: Url = None,
    key: Key = None,
    collection: Collection = None,
    options: dict[str, Any],
) -> None:
    """List stored shapes, or deleted ones."""
    if deleted and (options or sort != "relevance"):
        fail("--deleted takes no filter and no order", status=2)
    with service_at(url, key, collection) as client:
        every: Iterator[FileAndFields] = client.deleted() if deleted else client.shapes(sort=sort, **options)
        shapes = list(islice(every, limit or None))
        total = len(shapes) + sum(1 for _ in every) if deleted else client.page(limit=1, **options).total
    if as_json:
        _print_json(shapes)
    else:
        columns = ("name", "tags", "format", "deleted" if deleted else "sides", "stored", "id")
        listed = table(*columns, fold=("tags",))
        for shape in shapes:
            about = _day(shape.deleted_at) if isinstance(shape, DeletedShape) else _sides(shape)
            tags = ", ".join(shape.tags)
            listed.add_row(shape.name, tags, shape.format, about, _day(shape.created_at), shape.id)
        output().print(listed)
    say(f"{len(shapes)} of {count_of(total, 'shape')}")


def show_command(
    shapes: Names, *, as_json: AsJson = False, url: Url = None, key: Key = None, collection: Collection = None
) -> None:
    """Show all that is stored about shapes."""
    with service_at(url, key, collection) as client:
        found = shapes_named(client, shapes)
        if as_json:
            _print_json(found)
            return
        for shape in found:
            for name, value in [*_described(shape), *_on_disk(client, shape)]:
                typer.echo(f"{name:<14} {value}")


@with_options(Filters)
def tag_command(
    shapes: Annotated[
        list[str] | None, typer.Argument(metavar="[SHAPE...]", help="Ids of shapes, or their names.")
    ] = None,
    *,
    add: Annotated[list[str] | None, typer.Option(metavar="TAG", help="Add this tag; repeatable.")] = None,
    remove: Annotated[
        list[str] | None, typer.Option(metavar="TAG", help="Remove this tag; repeatable.")
    ] = None,
    url: Url = None,
    key: Key = None,
    collection: Collection = None,
    options: dict[str, Any],
) -> None:
    """Add tags to shapes, and remove tags.

    The shapes are named, or all shapes that pass a filter are changed, such as all of a material with
    `--metadata material=steel`.
    """
    if not (add or remove):
        fail("give --add TAG or --remove TAG", status=2)
    if bool(shapes) == bool(options):
        fail("name shapes, or give a filter such as --metadata KEY=VALUE", status=2)
    with service_at(url, key, collection) as client:
        if options:
            _tag_all(client, options, add or [], remove or [])
        for shape in shapes_named(client, shapes or []):
            tags = [tag for tag in dict.fromkeys([*shape.tags, *(add or [])]) if tag not in (remove or [])]
            changed = client.update(shape.id, tags=tags)
            say(f"{changed.name}: {', '.join(changed.tags) or 'no tags'}")


def _tag_all(client: Client, filters: dict[str, Any], add: Sequence[str], remove: Sequence[str]) -> None:
    """Change the tags of all shapes that pass filters; status 1 if a shape is refused."""
    values = {**filters, "tag": split_tags(filters.get("tag", [])), "add_tags": add, "remove_tags": remove}
    try:
        wanted = BulkChange.model_validate({**values, "dry_run": False})
    except ValidationError as error:
        fail("; ".join(f"{fault.field}: {fault.message}" for fault in faults_of(error.errors())), status=2)
    if not any(getattr(wanted, name) for name in filters):
        fail("the filter is empty, so that all shapes would be changed", status=2)
    done = client.update_all(wanted)
    say(f"{done.changed} of {count_of(done.matched, 'shape')} changed")
    for shape in done.refused:
        say(f"{shape.name} ({shape.id}): {shape.detail}")
    if done.refused:
        raise typer.Exit(1)


def delete_command(
    shapes: Names,
    *,
    permanent: Annotated[
        bool, typer.Option("--permanent", help="Delete for good: the shapes cannot be restored.")
    ] = False,
    url: Url = None,
    key: Key = None,
    collection: Collection = None,
) -> None:
    """Delete shapes."""
    with service_at(url, key, collection) as client:
        for shape in shapes_named(client, shapes):
            client.delete(shape.id, permanent=permanent)
            say(f"deleted {shape.name}" + ("" if permanent else f"; isoshape restore {shape.id}"))


def restore_command(
    shapes: Names, *, url: Url = None, key: Key = None, collection: Collection = None
) -> None:
    """Restore deleted shapes."""
    with service_at(url, key, collection) as client:
        removed = list(client.deleted())
        for shape in [_chosen(text, removed, "deleted shape") for text in shapes]:
            say(f"restored {client.restore(shape.id).name}")


def shapes_named(client: Client, texts: Sequence[str], kind: str = "shape") -> list[Shape]:
    """Return the stored shapes that ids or names name; nothing is changed before all of them are found.

    Raise ClientError if a text names no shape, or several.
    """
    return [
        client.shape(text) if _is_id(text) else _chosen(text, client.shapes(name=text), kind)
        for text in texts
    ]


def _is_id(text: str) -> bool:
    try:
        UUID(text)
    except ValueError:
        return False
    return True


def _chosen(text: str, shapes: Iterable[Stored], kind: str) -> Stored:
    """Return the one of some shapes with an id or a name."""
    named = [shape for shape in shapes if text in (shape.id, shape.name)]
    if not named:
        raise ClientError(f"no {kind} has the id or the name {text!r}")
    if len(named) > 1:
        ids = ", ".join(shape.id for shape in named)
        raise ClientError(f"{len(named)} shapes have the name {text!r}; give an id: {ids}")
    return named[0]


def _sides(shape: FileAndFields) -> str:
    assert isinstance(shape, Shape)
    return in_unit(box_in_words(shape.facts), shape.unit)


def _day(moment: datetime) -> str:
    return f"{moment:%Y-%m-%d}"


def _described(shape: Shape) -> list[tuple[str, str]]:
    """Return the names and the values of a record."""
    facts, unit = shape.facts, shape.unit
    volume = in_unit(volume_in_words(facts), unit and f"{unit}³") if facts.closed else volume_in_words(facts)
    pieces = "1 component" if facts.components == 1 else f"{facts.components:,} components"
    return [
        ("name", shape.name),
        ("id", shape.id),
        ("tags", ", ".join(shape.tags)),
        ("metadata", json.dumps(shape.metadata, ensure_ascii=False) if shape.metadata else ""),
        ("file", f"{shape.format}, {shape.bytes:,} bytes, SHA-256 {shape.sha256}"),
        ("sides", _sides(shape)),
        ("along x, y, z", in_unit(" × ".join(map(number_in_words, facts.file_box)), unit)),
        ("area", in_unit(number_in_words(facts.area), unit and f"{unit}²")),
        ("volume", volume),
        ("mesh", f"{facts.vertices:,} vertices, {facts.faces:,} faces, {pieces}"),
        ("stored", f"{shape.created_at:%Y-%m-%d %H:%M} UTC, changed {shape.updated_at:%Y-%m-%d %H:%M} UTC"),
        *(("warning", warning) for warning in shape.warnings),
    ]


def _on_disk(client: Client, shape: Shape) -> Iterator[tuple[str, str]]:
    """Yield the paths of a shape in the library, unless the key may not see them."""
    try:
        sources = client.sources().sources
    except ProblemError as error:
        if error.kind != "forbidden":
            raise
        return
    for source in sources:
        for file in client.source_files(source.id, shape_id=shape.id):
            state = "" if file.state == "present" else f" ({file.state})"
            yield "in the library", f"{source.path}/{file.path}{state}"


def _print_json(shapes: Sequence[BaseModel]) -> None:
    for shape in shapes:
        typer.echo(json.dumps(shape.model_dump(mode="json")))
