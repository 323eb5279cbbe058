"""Deleted shapes as they go between storage, service and endpoints."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any


@dataclass(frozen=True)
class DeletedRecord:
    """A deleted shape, without its bytes. `number` orders them by when they were deleted."""

    number: int
    id: str
    name: str
    tags: tuple[str, ...]
    metadata: Mapping[str, Any]
    format: str
    size: int
    sha256: str
    created_at: datetime
    deleted_at: datetime


@dataclass(frozen=True)
class DeletedPage:
    """Some deleted shapes, how many there are in all, and the number to go on after, if there are more."""

    shapes: list[DeletedRecord]
    total: int
    after: int | None
