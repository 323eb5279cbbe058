"""The measures that results can be sorted by."""

from typing import Literal

RankBy = Literal["cc", "ssd", "sim", "combined"]
