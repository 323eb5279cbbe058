"""The calls on stored shapes and their files."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import httpx
from pydantic import JsonValue

from service.client.calls import (
    LONGEST_PAGE,
    Call,
    Conditions,
    File,
    Step,
    conditions,
    content,
    given,
    nothing,
    pages,
    parsed,
    segment,
)
from service.shapes.assembly_schemas import Assembly
from service.shapes.deleted.schemas import DeletedShape, DeletedShapePage
from service.shapes.records import Sort
from service.shapes.schemas import EmbeddingArrays, Shape, ShapePage


@dataclass(frozen=True)
class Upload:
    """A stored shape, and whether this upload created it.

    `parts` has the distinct parts of an assembly that is uploaded with split="parts".
    """

    shape: Shape
    created: bool
    parts: tuple["Upload", ...] = ()


def fields_of(
    name: str | None, tags: Sequence[str], metadata: Mapping[str, JsonValue] | None
) -> dict[str, str | list[str]]:
    """The fields of a form that describe a shape."""
    return given(
        name=name,
        tags=",".join(tags) if tags else None,
        metadata=None if metadata is None else json.dumps(metadata),
    )


def upload(
    file: File,
    *,
    name: str | None = None,
    tags: Sequence[str] = (),
    metadata: Mapping[str, JsonValue] | None = None,
    split: Literal["parts"] | None = None,
) -> Call[Upload]:
    """Store a mesh. If its bytes are already stored under the same name, `created` is false.

    With split="parts", each distinct part of a STEP or 3MF is stored as a shape too.
    """

    def read(answer: httpx.Response) -> Upload:
        return Upload(parsed(Shape)(answer), created=answer.status_code == httpx.codes.CREATED)

    def read_assembly(answer: httpx.Response) -> Upload:
        found = parsed(Assembly)(answer)
        return Upload(found, found.created, tuple(Upload(part, part.created) for part in found.parts))

    data = fields_of(name, tags, metadata) | given(split=split)
    return Call("POST", "/shapes", read if split is None else read_assembly, data=data, file=file)


def page(
    *,
    tags: Sequence[str] = (),
    name: str | None = None,
    metadata: Conditions = (),
    area: str | None = None,
    volume: str | None = None,
    length: str | None = None,
    sort: Sort = "oldest",
    limit: int = 50,
    cursor: str | None = None,
) -> Call[ShapePage]:
    """Get one page of the stored shapes.

    `metadata` holds keys with values, or conditions of the form key=value; `area`, `volume` and `length` are
    ranges of the form min..max.
    """
    sizes = {"area": area, "volume": volume, "length": length}
    wanted = given(tag=list(tags), metadata=conditions(metadata), name=name, **sizes)
    wanted |= given(sort=sort, limit=limit, cursor=cursor)
    return Call("GET", "/shapes", parsed(ShapePage), params=wanted)


def shapes(
    *,
    tags: Sequence[str] = (),
    name: str | None = None,
    metadata: Conditions = (),
    area: str | None = None,
    volume: str | None = None,
    length: str | None = None,
    sort: Sort = "oldest",
) -> Call[Step[Shape]]:
    """Get all stored shapes that pass the filters, page by page; the filters are those of `page`."""

    def one(cursor: str | None) -> Call[ShapePage]:
        return page(
            tags=tags,
            name=name,
            metadata=metadata,
            area=area,
            volume=volume,
            length=length,
            sort=sort,
            limit=LONGEST_PAGE,
            cursor=cursor,
        )

    return pages(one, lambda found: found.shapes)


def shape(shape_id: str) -> Call[Shape]:
    """Get the record of a shape."""
    return Call("GET", f"/shapes/{segment(shape_id)}", parsed(Shape))


def file(shape_id: str, *, format: str | None = None) -> Call[bytes]:
    """Get the uploaded file, or the mesh in another format."""
    return Call("GET", f"/shapes/{segment(shape_id)}/file", content, params=given(format=format))


def embedding(shape_id: str) -> Call[EmbeddingArrays]:
    """Get the embedding of a shape."""
    return Call("GET", f"/shapes/{segment(shape_id)}/embedding", parsed(EmbeddingArrays))


def thumbnail(shape_id: str, *, size: Literal[64, 128, 256, 512] = 256) -> Call[bytes]:
    """Get a PNG of `size` by `size` pixels with a transparent background."""
    return Call("GET", f"/shapes/{segment(shape_id)}/thumbnail.png", content, params={"size": size})


def preview(shape_id: str) -> Call[bytes]:
    """Get the mesh for a viewer: a GLB with y up and coordinates in [-1, 1]; a large mesh is simplified."""
    return Call("GET", f"/shapes/{segment(shape_id)}/preview.glb", content)


def preview_file(file: File) -> Call[bytes]:
    """Get the preview of a file that is not stored."""
    return Call("POST", "/preview", content, file=file)


def replace_file(shape_id: str, file: File, *, if_sha256: str | None = None) -> Call[Shape]:
    """Replace the file of a shape; with `if_sha256`, only if the present file has that SHA-256."""
    headers = {} if if_sha256 is None else {"If-Match": f'"{if_sha256}"'}
    return Call("PUT", f"/shapes/{segment(shape_id)}/file", parsed(Shape), headers=headers, file=file)


def update(
    shape_id: str,
    *,
    name: str | None = None,
    tags: Sequence[str] | None = None,
    metadata: Mapping[str, JsonValue] | None = None,
) -> Call[Shape]:
    """Replace the given fields of a shape; the others stay."""
    changes: dict[str, Any] = given(
        name=name,
        tags=None if tags is None else list(tags),
        metadata=None if metadata is None else dict(metadata),
    )
    return Call("PATCH", f"/shapes/{segment(shape_id)}", parsed(Shape), json=changes)


def delete(shape_id: str, *, permanent: bool = False) -> Call[None]:
    """Delete a shape; with `permanent`, for good at once."""
    wanted = given(permanent=permanent or None)
    return Call("DELETE", f"/shapes/{segment(shape_id)}", nothing, params=wanted)


def deleted() -> Call[Step[DeletedShape]]:
    """List the deleted shapes that can be restored, the first deleted first."""

    def one(cursor: str | None) -> Call[DeletedShapePage]:
        wanted = given(limit=LONGEST_PAGE, cursor=cursor)
        return Call("GET", "/deleted", parsed(DeletedShapePage), params=wanted)

    return pages(one, lambda found: found.shapes)


def restore(shape_id: str) -> Call[Shape]:
    """Restore a deleted shape."""
    return Call("POST", f"/shapes/{segment(shape_id)}/restore", parsed(Shape))


def purge(shape_id: str) -> Call[None]:
    """Delete a deleted shape permanently."""
    return Call("DELETE", f"/deleted/{segment(shape_id)}", nothing)
