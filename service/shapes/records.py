"""Values that describe shapes between storage, service and endpoints."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cached_property
from typing import Any, Literal

from service.collection import CollectionNumber

Range = tuple[float, float]
"""Least and greatest value of a measurement; infinite where a side is open."""

FileKey = tuple[str, str]
"""The SHA-256 of a file, and its format."""


@dataclass(frozen=True)
class ShapeRecord:
    """A stored shape, without its bytes.

    `number` orders shapes by creation and is never sent to clients. `embedded` tells whether the active
    pipeline has embedded the shape. `deleted_at` is None unless the shape is deleted.
    """

    number: int
    id: str
    name: str
    tags: tuple[str, ...]
    metadata: Mapping[str, Any]
    format: str
    bytes: int
    sha256: str
    facts: Mapping[str, Any]
    embedded: bool
    created_at: datetime
    updated_at: datetime
    deleted_at: datetime | None = None


@dataclass(frozen=True)
class NewFile:
    """A file to store. With `in_place`, its bytes stay in the folder of a source alone."""

    data: bytes
    format: str
    in_place: bool = field(default=False, kw_only=True)

    @cached_property
    def sha256(self) -> str:
        """The SHA-256 of the bytes, as 64 hexadecimal digits."""
        return sha256(self.data)

    @property
    def key(self) -> FileKey:
        """The SHA-256 and the format."""
        return self.sha256, self.format


@dataclass(frozen=True)
class NewShape(NewFile):
    """A file to store as a shape, its collection and its fields, and whether it is a part of another."""

    collection: CollectionNumber
    name: str
    tags: tuple[str, ...]
    metadata: Mapping[str, Any]
    is_part: bool = False


@dataclass(frozen=True)
class StoredFile:
    """The number of a file's blob, the facts of its mesh, and whether the blob is new."""

    blob_number: int
    facts: Mapping[str, Any]
    created: bool


@dataclass(frozen=True)
class ShapeFilter:
    """A filter of the shapes of a collection: all conditions must hold.

    A shape that passes has all `words` (`service.shapes.word_repository`), `by_paths` also in the paths of
    its files, each of `tags`, a name that contains `name` in any case, the keys and values of `metadata`, a
    file of the format `file_format` and with the SHA-256 `sha256`, and none of the ids `excluded`. Its
    surface area, volume and largest extent of the bounding box, in units of the file, are in the ranges
    `area`, `volume` and `length`. Open surfaces have no volume.
    """

    collection: CollectionNumber
    tags: tuple[str, ...] = ()
    name: str | None = None
    metadata: tuple[tuple[str, str], ...] = ()
    file_format: str | None = None
    excluded: tuple[str, ...] = ()
    area: Range | None = None
    volume: Range | None = None
    length: Range | None = None
    words: str | None = None
    by_paths: bool = False
    sha256: str | None = None

    @property
    def is_empty(self) -> bool:
        """Whether every shape of the collection matches."""
        return self == ShapeFilter(self.collection)

    @property
    def has_sizes(self) -> bool:
        """Whether a condition is about size."""
        return any(size is not None for size in (self.area, self.volume, self.length))

    def scaled(self, factor: float) -> "ShapeFilter":
        """Return the same conditions on shapes that are `factor` times as large."""

        def times(values: Range | None, power: int) -> Range | None:
            return None if values is None else (values[0] * factor**power, values[1] * factor**power)

        return replace(
            self, area=times(self.area, 2), volume=times(self.volume, 3), length=times(self.length, 1)
        )


@dataclass(frozen=True)
class StoredShape:
    """A shape after an upload, and whether the upload created it, or which fields of it changed."""

    shape: ShapeRecord
    created: bool
    changed: tuple[Literal["tags", "metadata"], ...] = ()


Sort = Literal["relevance", "oldest", "newest", "name"]
"""The order of a list of shapes: by how well words match, by the time of storing, or by name, upper and lower
case alike."""


@dataclass(frozen=True)
class Position:
    """A position in a list of shapes: the number of a shape, and what the list is sorted by.

    `name` is its name in lower case in a list by name, and `points` its points in a list by relevance.
    """

    number: int
    name: str | None = None
    points: int | None = None


def sha256(data: bytes) -> str:
    """Return the SHA-256 of some bytes, as 64 hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()
