"""Cursors of pages: opaque to clients, so that their content may change."""

import base64
import binascii
import json
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from service.errors import BadRequestFieldsError, FieldFault
from service.shapes.records import Place, Sort

Item = TypeVar("Item")


@dataclass(frozen=True)
class Page(Generic[Item]):
    """A page of a list, the number of all items, and the cursor's number if more follow."""

    items: list[Item]
    total: int
    after: int | None


def write_cursor(after: int) -> str:
    """The cursor of the page after the row with a number."""
    return _written({"after": after})


def write_place(place: Place) -> str:
    """The cursor of the page after a place in a list of shapes."""
    name = {} if place.name is None else {"name": place.name}
    return _written({"after": place.number, **name})


def read_cursor(cursor: str | None) -> int:
    """The number in a cursor; 0 for the first page.

    Raises
    ------
    BadRequestFieldsError
        The cursor is malformed.
    """
    if cursor is None:
        return 0
    after = _read(cursor).get("after")
    if not isinstance(after, int) or not 0 <= after < 2**63:
        raise _fault()
    return after


def read_place(cursor: str | None, sort: Sort) -> Place | None:
    """The place in a cursor of a list with an order; None for the first page.

    Raises
    ------
    BadRequestFieldsError
        The cursor is malformed, or of a list with another order.
    """
    if cursor is None:
        return None
    number, name = read_cursor(cursor), _read(cursor).get("name")
    if isinstance(name, str) != (sort == "name"):
        raise _fault(f"the cursor belongs to a list in another order than sort={sort}")
    return Place(number, name)


def _fault(message: str = "this service did not create the cursor") -> BadRequestFieldsError:
    return BadRequestFieldsError(FieldFault("cursor", message))


def _written(content: dict[str, Any]) -> str:
    return base64.urlsafe_b64encode(json.dumps(content).encode()).decode().rstrip("=")


def _read(cursor: str) -> dict[str, Any]:
    try:
        content = json.loads(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
    except (binascii.Error, ValueError):
        content = None
    if not isinstance(content, dict):
        raise _fault()
    return content
