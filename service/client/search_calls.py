"""The calls that search and compare."""

from collections.abc import Callable, Sequence
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar

import httpx

from service.client.requests import Call, File, conditions, content, parsed, segment
from service.search.compare_schemas import CompareAnswer
from service.search.schemas import QueryAnswer, SearchOptions

P = ParamSpec("P")
T = TypeVar("T")


def _with_search_options(make: Callable[P, Call[QueryAnswer]]) -> Callable[P, Call[QueryAnswer]]:
    """Give a call the signature with the options of `SearchOptions`, which it passes on as they are given."""
    *parameters, _ = signature(make).parameters.values()
    options = [
        Parameter(name, Parameter.KEYWORD_ONLY, annotation=field.annotation, default=field.get_default())
        for name, field in SearchOptions.model_fields.items()
    ]
    make.__dict__["__signature__"] = Signature([*parameters, *options], return_annotation=Call[QueryAnswer])
    return make


@_with_search_options
def query_file(file: File, **options: Any) -> Call[QueryAnswer]:  # noqa: ANN401
    """Find the stored shapes most similar to a file.

    The options are those of `service.search.schemas.SearchOptions`; metadata may be a mapping.
    """
    return Call("POST", "/query", parsed(QueryAnswer), data=_texts(_checked(options)), files={"file": file})


@_with_search_options
def similar(shape_id: str, **options: Any) -> Call[QueryAnswer]:  # noqa: ANN401
    """Find the stored shapes most similar to a stored shape; the options are part of the address."""
    path = f"/shapes/{segment(shape_id)}/similar"
    return Call("GET", path, parsed(QueryAnswer), params=_texts(_checked(options)))


@_with_search_options
def query_shape(shape_id: str, **options: Any) -> Call[QueryAnswer]:  # noqa: ANN401
    """Return the answer of `similar`; the options are in the body, so a long list of ids fits."""
    return Call("POST", "/query", parsed(QueryAnswer), json={"shape_id": shape_id, **_checked(options)})


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


def _checked(options: dict[str, Any]) -> dict[str, Any]:
    """Return options of a search, each sequence as a list.

    Raises
    ------
    TypeError
        An option is unknown.
    """
    unknown = options.keys() - SearchOptions.model_fields.keys()
    if unknown:
        raise TypeError(f"a search has no option {min(unknown)!r}")
    if "metadata" in options:
        options["metadata"] = conditions(options["metadata"])
    return {
        name: list(value) if isinstance(value, Sequence) and not isinstance(value, str) else value
        for name, value in options.items()
    }


def _texts(options: dict[str, Any]) -> dict[str, str | list[str]]:
    return {name: _field(value) for name, value in options.items()}


def _field(value: object) -> str | list[str]:
    """Return a query option as the text of a form field or query parameter; a list repeats the field."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return list(value)
    return str(value)
