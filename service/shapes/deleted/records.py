"""Values that describe deleted shapes between storage, service and endpoints."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any


@dataclass(frozen=True)
class DeletedRecord:
    """A deleted shape, without its bytes. `number` orders deleted shapes by the time of deletion."""

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
    """A page of deleted shapes, the number of all, and the number of its last shape if more follow."""

    shapes: list[DeletedRecord]
    total: int
    after: int | None
