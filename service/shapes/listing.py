"""Lists of shapes: filters as clients write them, the same for all operations, and cursors of pages."""

import base64
import binascii
import json
import math
import re
from dataclasses import dataclass
from typing import Annotated, Any, Generic, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from service.collection import CollectionNumber
from service.errors import BadRequestFieldsError, FieldFault
from service.shapes.fields import ListedTags, clean_text
from service.shapes.records import Position, Range, ShapeFilter, Sort

METADATA_FILTERS = 32

NUMBER = r"[0-9]+(\.[0-9]+)?([eE][+-]?[0-9]{1,3})?"
RANGE = rf"^({NUMBER}\.\.({NUMBER})?|\.\.{NUMBER})$"


def range_of(text: str) -> Range:
    """Return the least and the greatest value of a range, written min..max.

    Raises
    ------
    ValueError
        It is written otherwise, has no side, or its least value exceeds its greatest.
    """
    if re.search(RANGE, text) is None or text.endswith("\n"):
        raise ValueError("must be written min..max, with numbers of 0 or more; one of them may be left out")
    least, greatest = text.split("..")
    values = float(least or 0.0), float(greatest or math.inf)
    if values[0] > values[1]:
        raise ValueError(f"the least value {least} exceeds the greatest value {greatest}")
    return values


def _checked_range(text: str) -> str:
    range_of(text)
    return text


SizeRange = Annotated[
    str,
    AfterValidator(_checked_range),
    Field(max_length=64, json_schema_extra={"pattern": RANGE}),
]


class Filters(BaseModel):
    """Conditions on shapes; a shape must satisfy all of them."""

    model_config = ConfigDict(extra="forbid")

    tag: ListedTags = Field(
        default=[],
        description="Only shapes with this tag; with all tags, if repeated or separated by commas.",
        examples=[["animal"]],
    )
    name: Annotated[str, AfterValidator(clean_text)] | None = Field(
        default=None,
        max_length=255,
        description="Only shapes whose name contains this text; upper and lower case are equal.",
    )
    metadata: list[Annotated[str, Field(json_schema_extra={"pattern": "^[^=]+="})]] = Field(
        default=[],
        max_length=METADATA_FILTERS,
        description="Only shapes with this entry in their metadata, as key=value; with all entries, if "
        "repeated. Values other than text are written as JSON.",
        examples=[["source=scan"]],
    )
    area: SizeRange | None = Field(
        default=None,
        description="Only shapes whose surface area is in this range, written min..max, in squared units of "
        "the files; one side may be left out.",
        examples=["100..250"],
    )
    volume: SizeRange | None = Field(
        default=None,
        description="Only shapes whose volume is in this range, in cubed units of the files. Open surfaces "
        "have no volume.",
        examples=["1000.."],
    )
    length: SizeRange | None = Field(
        default=None,
        description="Only shapes whose bounding box has a largest extent in this range, in units of the "
        "files.",
        examples=["..60"],
    )

    def filtered(self, collection: CollectionNumber) -> ShapeFilter:
        """Return the filter of the shapes of a collection.

        Raises
        ------
        BadRequestFieldsError
            A condition on metadata is not written key=value.
        """
        metadata = []
        for pair in self.metadata:
            key, equals, value = pair.partition("=")
            if not (key and equals):
                raise BadRequestFieldsError(FieldFault("metadata", "must be written key=value"))
            metadata.append((key, value))
        area, volume, length = (
            None if text is None else range_of(text) for text in (self.area, self.volume, self.length)
        )
        return ShapeFilter(
            collection,
            tuple(self.tag),
            self.name,
            tuple(metadata),
            area=area,
            volume=volume,
            length=length,
        )


Item = TypeVar("Item")


@dataclass(frozen=True)
class Page(Generic[Item]):
    """A page of a list, the number of all items, and the cursor of the next page if more follow."""

    items: list[Item]
    total: int
    next_cursor: str | None


def write_cursor(after: int) -> str:
    """Return the cursor of the page after the row with a number."""
    return _written({"after": after})


def write_position(position: Position) -> str:
    """Return the cursor of the page after a position in a list of shapes."""
    name = {} if position.name is None else {"name": position.name}
    return _written({"after": position.number, **name})


def read_cursor(cursor: str | None) -> int:
    """Return the number in a cursor; 0 for the first page.

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


def read_position(cursor: str | None, sort: Sort) -> Position | None:
    """Return the position in a cursor of a list with an order; None for the first page.

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
    return Position(number, name)


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
