"""Decisions and the pairs that they are on."""

from typing import Literal

Decision = Literal["same", "variant", "different", "ignore"]
"""The decision of a person on two near-identical shapes."""

Pair = tuple[str, str]
"""The SHA-256 of two files, the lesser first."""


def pair_of(first: str, second: str) -> Pair:
    """Return the pair of two SHA-256."""
    return min(first, second), max(first, second)
