"""Collections as values between storage, service and endpoints, and as JSON."""

import re
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, NewType

from pydantic import BaseModel, ConfigDict, Field

CollectionNumber = NewType("CollectionNumber", int)
"""The number of a collection; it is never reused, so that stored data never change their collection."""

NAME = "[a-z0-9][a-z0-9_-]{0,63}"
"""The pattern of names, whose characters need no escaping in an address, a header or a list of keys."""

_NAME = re.compile(NAME)


@dataclass(frozen=True)
class CollectionRecord:
    """A named set of shapes, and whether the request that names it may see the paths of files."""

    number: CollectionNumber
    name: str
    shows_paths: bool = field(default=False, compare=False)


DEFAULT_COLLECTION = CollectionRecord(CollectionNumber(1), "default")
"""The collection of requests that name none. It exists in every archive."""


def is_name(text: str) -> bool:
    """Return whether a collection may have the name."""
    return _NAME.fullmatch(text) is not None


COLLECTION: dict[str, Any] = {"name": "castings", "shapes": 190, "created_at": "2026-01-31T12:00:00Z"}


class Collection(BaseModel):
    """A named set of shapes."""

    model_config = ConfigDict(from_attributes=True, json_schema_extra={"example": COLLECTION})

    name: str = Field(description="The name by which requests choose the collection.")
    shapes: int = Field(description="The number of its shapes.")
    created_at: datetime = Field(description="UTC.")


class Collections(BaseModel):
    """The collections that the key may use, sorted by name."""

    model_config = ConfigDict(json_schema_extra={"example": {"collections": [COLLECTION]}})

    collections: list[Collection]
