"""The calls that search and compare."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, TypedDict, TypeVar, Unpack

import httpx

from service.client.requests import Call, Conditions, File, conditions, content, parsed, segment
from service.search.compare_schemas import CompareAnswer
from service.search.schemas import QueryAnswer, RankBy

T = TypeVar("T")


class QueryArguments(TypedDict, total=False):
    """The options of a query. `service.search.schemas.QueryOptions` describes each and has its default."""

    top_k: int
    rank_by: RankBy
    partial: bool
    exhaustive: bool
    tag: Sequence[str]
    name: str
    metadata: Conditions
    area: str
    volume: str
    length: str
    exclude: Sequence[str]
    min_cc: float
    scale: Literal["ignore", "respect"]
    size_tolerance: float
    exclude_self: bool
    correspondences: bool
    embedding: bool


def query_file(file: File, **options: Unpack[QueryArguments]) -> Call[QueryAnswer]:
    """Find the stored shapes most similar to a file."""
    return Call("POST", "/query", parsed(QueryAnswer), data=_fields(options), files={"file": file})


def similar(shape_id: str, **options: Unpack[QueryArguments]) -> Call[QueryAnswer]:
    """Find the stored shapes most similar to a stored shape; the options are part of the address."""
    return Call("GET", f"/shapes/{segment(shape_id)}/similar", parsed(QueryAnswer), params=_fields(options))


def query_shape(shape_id: str, **options: Unpack[QueryArguments]) -> Call[QueryAnswer]:
    """Return the answer of `similar`; the options are in the body, so a long list of ids fits."""
    body: dict[str, Any] = {"shape_id": shape_id, **options}
    for name in {"exclude", "tag"} & set(body):
        body[name] = list(body[name])
    if "metadata" in options:
        body["metadata"] = conditions(options["metadata"])
    return Call("POST", "/query", parsed(QueryAnswer), json=body)


Compared = str | Path | tuple[str, bytes]
"""A shape to compare: the id of a stored shape, or a file as its path or as its name and bytes."""


def compare(first: Compared, second: Compared, *, dense: bool = False) -> Call[CompareAnswer]:
    """Compare two shapes point by point, with `dense` vertex by vertex.

    A text is the id of a stored shape; a `Path`, or a name with bytes, is a file.
    """
    return _compared(first, second, parsed(CompareAnswer), {"dense": True} if dense else {}, {})


def dense_file(
    first: Compared,
    second: Compared,
    format: Literal["npz", "glb", "png"],
    paint: Literal["correspondence", "difference"] = "correspondence",
) -> Call[bytes]:
    """Return the dense correspondence of two shapes as a NumPy archive, a GLB or a picture."""
    params: dict[str, str] = {"format": format, "paint": paint}
    return _compared(first, second, content, {"dense": True}, params)


def _compared(
    first: Compared,
    second: Compared,
    read: Callable[[httpx.Response], T],
    options: dict[str, bool],
    params: dict[str, str],
) -> Call[T]:
    """Send JSON with two ids, or a form if one of the shapes is a file."""
    shapes = {"first": first, "second": second}
    files = {name: shape for name, shape in shapes.items() if not isinstance(shape, str)}
    ids = {name: shape for name, shape in shapes.items() if isinstance(shape, str)}
    if not files:
        return Call("POST", "/compare", read, params=params, json={**ids, **options})
    fields = {name: _field(value) for name, value in options.items()}
    return Call("POST", "/compare", read, params=params, data={**ids, **fields}, files=files)


def _fields(options: QueryArguments) -> dict[str, str | list[str]]:
    fields = {name: _field(value) for name, value in options.items()}
    if "metadata" in options:
        fields["metadata"] = conditions(options["metadata"])
    return fields


def _field(value: object) -> str | list[str]:
    """Return a query option as the text of a form field or query parameter; a list repeats the field."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return list(value)
    return str(value)
