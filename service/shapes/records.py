"""Shapes as they go between storage, service and endpoints."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from typing import Any

from service.collection import CollectionNumber


@dataclass(frozen=True)
class ShapeRecord:
    """A stored shape, without its bytes.

    `number` orders shapes by creation and stays inside the service; `embedded` is whether it has an embedding
    of the pipeline in use.
    """

    number: int
    id: str
    name: str
    tags: tuple[str, ...]
    metadata: Mapping[str, Any]
    format: str
    size: int
    sha256: str
    facts: Mapping[str, Any]
    embedded: bool
    created_at: datetime
    updated_at: datetime


@dataclass(frozen=True)
class NewFile:
    """A file to be stored."""

    data: bytes
    format: str

    @cached_property
    def sha256(self) -> str:
        """Of the file, as hexadecimal digits."""
        return sha256(self.data)


@dataclass(frozen=True)
class NewShape(NewFile):
    """A file to be stored, in which collection, and what is written about it.

    A shape that is restored has its id and the time of its creation already.
    """

    collection: CollectionNumber
    name: str
    tags: tuple[str, ...]
    metadata: Mapping[str, Any]
    id: str | None = None
    created_at: datetime | None = None


@dataclass(frozen=True)
class StoredFile:
    """Where the bytes of a file are, what was measured on its mesh, and whether the bytes came just now."""

    blob_number: int
    facts: Mapping[str, Any]
    created: bool


@dataclass(frozen=True)
class Changes:
    """What to change of a shape; None leaves a part as it is."""

    name: str | None = None
    tags: tuple[str, ...] | None = None
    metadata: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class ShapeFilter:
    """Which shapes of a collection are meant: with every tag, the text in their name, and every plain value.

    `metadata` holds pairs of key and value, `excluded` the ids of shapes that are not meant, and `area` the
    least and the most surface in squared units of the files.
    """

    collection: CollectionNumber
    tags: tuple[str, ...] = ()
    name: str | None = None
    metadata: tuple[tuple[str, str], ...] = ()
    excluded: tuple[str, ...] = ()
    area: tuple[float, float] | None = None

    @property
    def is_empty(self) -> bool:
        """Whether every shape of the collection is meant."""
        return self == ShapeFilter(self.collection)


@dataclass(frozen=True)
class Stored:
    """A shape after an upload, and whether the upload made it."""

    shape: ShapeRecord
    created: bool


@dataclass(frozen=True)
class Page:
    """Some shapes, how many there are in all, and the number to go on after, if there are more."""

    shapes: list[ShapeRecord]
    total: int
    after: int | None


def sha256(data: bytes) -> str:
    """The hash of a file's bytes, as hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()
