"""Decisions between storage, service and endpoints."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

Decision = Literal["same", "variant", "different", "ignore"]
"""The decision of a person on two near-identical shapes."""

Pair = tuple[str, str]
"""The SHA-256 of two files, the lesser first."""


def pair_of(first: str, second: str) -> Pair:
    """Return the pair of two SHA-256."""
    return min(first, second), max(first, second)


@dataclass(frozen=True)
class DecisionRecord:
    """A decision on a pair of files, and the names by id of the stored shapes that have them."""

    number: int
    id: str
    pair: Pair
    decision: Decision
    decided_by: str | None
    reason: str
    decided_at: datetime
    shapes: tuple[Mapping[str, str], Mapping[str, str]] = ({}, {})
