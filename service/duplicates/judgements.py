"""A search for near-identical shapes, its bounds, and its judgement of one shape."""

from collections.abc import Sequence
from dataclasses import dataclass

from core.registration.similarity import RESIDUAL
from service.duplicates.groups import Link

MIN_CC = 0.98
"""Least CC of two shapes that are registered. Poses of one body pass this limit too."""


@dataclass(frozen=True)
class Search:
    """A search for copies, or for copies and variants, by one pipeline, and the bounds of its pairs."""

    fingerprint: str
    variants: bool
    min_cc: float = MIN_CC
    max_residual: float = RESIDUAL


@dataclass(frozen=True)
class Judgement:
    """A shape by number, its copies and variants, and the numbers of compared and registered pairs."""

    shape: int
    links: Sequence[Link]
    compared: int
    aligned: int
