"""Repeated measurements: their median and quartiles, and how they grow with size."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Spread:
    """Median and quartiles of repeated measurements.

    Attributes
    ----------
    median, low, high : float
        Median, first and third quartile.
    count : int
        Number of measurements.
    """

    median: float
    low: float
    high: float
    count: int

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        """The distribution of one or more values."""
        low, median, high = np.percentile(values, [25.0, 50.0, 75.0])
        return cls(float(median), float(low), float(high), len(values))

    def milliseconds(self, digits: int = 1) -> str:
        """Format seconds for a table: median and quartiles in milliseconds, with `digits` decimals."""
        return Spread(1e3 * self.median, 1e3 * self.low, 1e3 * self.high, self.count).plain(digits)

    def plain(self, digits: int) -> str:
        """Format values for a table: median and quartiles, with `digits` decimals."""
        return f"{self.median:,.{digits}f} ({self.low:,.{digits}f} to {self.high:,.{digits}f})"


def growth_exponent(sizes: Sequence[float], values: Sequence[float]) -> float:
    """The exponent b of values = a sizes^b, by least squares of logarithms; of two or more sizes."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])
