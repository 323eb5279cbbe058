"""Collections as they go between storage, service and endpoints."""

import re
from dataclasses import dataclass
from datetime import datetime
from typing import NewType

CollectionNumber = NewType("CollectionNumber", int)
"""Counts up and is never used again, so that what is stored never comes to lie in another collection."""

NAME = "[a-z0-9][a-z0-9_-]{0,63}"
"""What a collection may be called: nothing that must be escaped in an address, a header or a list of keys."""

_NAME = re.compile(NAME)


@dataclass(frozen=True)
class Collection:
    """A named set of shapes."""

    number: CollectionNumber
    name: str


DEFAULT_COLLECTION = Collection(CollectionNumber(1), "default")
"""What a call without a name works in. Every archive has it."""


@dataclass(frozen=True)
class Counted:
    """A collection, when it was made, and how many shapes it has."""

    name: str
    created_at: datetime
    shapes: int


def is_name(text: str) -> bool:
    """Whether a collection may be called so."""
    return _NAME.fullmatch(text) is not None
