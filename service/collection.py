"""Collections as values between storage, service and endpoints."""

import re
from dataclasses import dataclass
from typing import NewType

CollectionNumber = NewType("CollectionNumber", int)
"""The number of a collection; it is never reused, so that stored data never change their collection."""

NAME = "[a-z0-9][a-z0-9_-]{0,63}"
"""The pattern of names, whose characters need no escaping in an address, a header or a list of keys."""

_NAME = re.compile(NAME)


@dataclass(frozen=True)
class CollectionRecord:
    """A named set of shapes."""

    number: CollectionNumber
    name: str


DEFAULT_COLLECTION = CollectionRecord(CollectionNumber(1), "default")
"""The collection of requests that name none. It exists in every archive."""


def is_name(text: str) -> bool:
    """Return whether a collection may have the name."""
    return _NAME.fullmatch(text) is not None
