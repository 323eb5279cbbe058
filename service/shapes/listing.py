"""Lists of shapes: filters as clients write them, the same for all operations, and cursors of pages."""

import base64
import json
import math
import re
from typing import Annotated, Any

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


SizeRange = Annotated[
    str,
    AfterValidator(lambda text: range_of(text) and text),
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
        sizes = {"area": self.area, "volume": self.volume, "length": self.length}
        ranges: dict[str, Any] = {name: range_of(text) for name, text in sizes.items() if text is not None}
        return ShapeFilter(collection, tuple(self.tag), self.name, tuple(metadata), **ranges)


class Page(BaseModel):
    """The place of a page in its list."""

    total: int = Field(description="The number of items over all pages.")
    next_cursor: str | None = Field(description="The `cursor` of the next page; null on the last page.")


def write_cursor(after: int, name: str | None = None) -> str:
    """Return the cursor of the page after the row with a number, and a name in a list by name."""
    content = {"after": after} if name is None else {"after": after, "name": name}
    return base64.urlsafe_b64encode(json.dumps(content).encode()).decode().rstrip("=")


def read_cursor(cursor: str | None) -> int:
    """Return the number in a cursor; 0 for the first page. It raises the errors of `read_position`."""
    position = read_position(cursor, "oldest")
    return 0 if position is None else position.number


def read_position(cursor: str | None, sort: Sort) -> Position | None:
    """Return the position in a cursor of a list with an order; None for the first page.

    Raises
    ------
    BadRequestFieldsError
        The cursor is malformed, or of a list with another order.
    """
    if cursor is None:
        return None
    try:
        content = json.loads(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
        number, name = content["after"], content.get("name")
    except (AttributeError, KeyError, TypeError, ValueError):
        number = name = None
    if not isinstance(number, int) or not 0 <= number < 2**63:
        raise BadRequestFieldsError(FieldFault("cursor", "this service did not create the cursor"))
    if isinstance(name, str) != (sort == "name"):
        message = f"the cursor belongs to a list in another order than sort={sort}"
        raise BadRequestFieldsError(FieldFault("cursor", message))
    return Position(number, name)
