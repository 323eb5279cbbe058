"""Where two shapes differ that are rigid copies elsewhere, and how much, in numbers and in words."""

import math

from pydantic import BaseModel, ConfigDict, Field, computed_field

from core.ranking.likeness import TOLD_SIZE, size_is_told

Coordinates = tuple[float, float, float]

SIDES = ("length", "width", "height")

EXTENT = 0.5
"""Sides differ if they do by more than this share of the largest distance; chord errors are less."""

LEAST_EXTENT = 0.01
"""Sides also differ by more than this share of the longest side, however large a hole or a boss is."""

LEAST_RATIO = 5e-5
"""Ratios of volumes, and of areas, nearer to 1 are told as equal."""


class LocalDifference(BaseModel):
    """Where two shapes differ that are rigid copies elsewhere, and how much.

    Coordinates and lengths are those of the first shape; of duplicates, those of the older one.
    """

    model_config = ConfigDict(from_attributes=True)

    scale: float = Field(
        default=1.0,
        description="The size of the second over that of the first; both are compared in one size.",
    )
    point: Coordinates | None = Field(
        default=None,
        description="Where they are farthest apart, in the first shape's coordinates; of duplicates, in "
        "those of the older shape, or null where these are unknown.",
    )
    low: Coordinates | None = Field(
        default=None,
        description="The corner of least coordinates of a box around all differences; null without `point`.",
    )
    high: Coordinates | None = Field(
        default=None, description="The corner of largest coordinates of this box; null without `point`."
    )
    distance: float = Field(
        description="The largest distance of the two surfaces, in the first's units; of duplicates, in those "
        "of the older shape."
    )
    sides: tuple[Coordinates, Coordinates] = Field(
        description="The extents of the first and of the second along the length, width and height of the "
        "least box around the first, or, of duplicates, around one of them; in the units of `distance`, both "
        "in one size."
    )
    volume: float | None = Field(
        default=None,
        description="The volume of the second over that of the first, both in one size, if both are closed.",
    )
    area: float = Field(description="The area of the second over that of the first, both in one size.")
    through_holes: tuple[int, int] | None = Field(
        default=None,
        description="The numbers of through holes of the first and of the second, if both are closed.",
    )

    @computed_field(  # type: ignore[prop-decorator]
        description="How the second differs from the first, in words: through holes, lengths or the largest "
        "distance; the middle and the size of the box, if they are known; the volume, or the area of open "
        "surfaces. It begins with the words at equal size if the sizes differ by more than "
        f"{100 * TOLD_SIZE:.1f} %."
    )
    @property
    def text(self) -> str:
        """The difference in words: "4 through holes instead of 3, at (10, 5, 0), ..."."""
        more = f"{_more(self.area)} area" if self.volume is None else f"{_more(self.volume)} volume"
        changes = self._holes() + self._lengths() or [
            f"surfaces up to {_rounded(self.distance, _digits(self.distance))} apart"
        ]
        begin = "at equal size: " if size_is_told(self.scale) else ""
        return f"{begin}{', '.join([*changes, *self._place()])}; {more}"

    def reverse(self) -> "LocalDifference":
        """Return how the first differs from the second, in the same coordinates and units."""
        holes, (ours, theirs) = self.through_holes, self.sides
        return self.model_copy(
            update={
                "scale": 1.0 / self.scale,
                "sides": (theirs, ours),
                "volume": self.volume and 1.0 / self.volume,
                "area": 1.0 / self.area,
                "through_holes": holes and (holes[1], holes[0]),
            }
        )

    def without_place(self, size: float) -> "LocalDifference":
        """Return the difference without its coordinates, its lengths `size` times as large."""
        ours, theirs = (tuple(size * side for side in sides) for sides in self.sides)
        lengths = {"distance": size * self.distance, "sides": (ours, theirs)}
        return self.model_copy(update={"point": None, "low": None, "high": None, **lengths})

    def _place(self) -> list[str]:
        """Return the middle and the size of the box: nothing if its coordinates are unknown."""
        if self.low is None or self.high is None:
            return []
        corners = list(zip(self.low, self.high, strict=True))
        digits = _digits(self.distance)
        middle = ", ".join(_rounded(0.5 * (low + high), digits) for low, high in corners)
        box = " × ".join(_rounded(high - low, digits) for low, high in corners)
        return [f"at ({middle})", f"in a box of {box}"]

    def _holes(self) -> list[str]:
        """Return what the numbers of through holes say: nothing if they are equal or unknown."""
        before, after = self.through_holes or (0, 0)
        holes = f"{after or 'no'} through hole{'' if after == 1 else 's'}"
        return [] if before == after else [f"{holes} instead of {before or 'none'}"]

    def _lengths(self) -> list[str]:
        """Return the sides that the second has longer or shorter."""
        told = []
        least = min(EXTENT * self.distance, LEAST_EXTENT * self.sides[0][0])
        for name, before, after in zip(SIDES, *self.sides, strict=True):
            change = abs(after - before)
            if change > least:
                digits = _digits(change)
                told.append(f"{name} {_rounded(after, digits)} instead of {_rounded(before, digits)}")
        return told


def _digits(size: float) -> int:
    """Return the decimals that show two digits of a size."""
    return 1 - math.floor(math.log10(size)) if size > 0.0 else 0


def _rounded(value: float, digits: int) -> str:
    # Adding 0 turns -0 into 0.
    text = f"{round(value, digits) + 0.0:.{max(digits, 0)}f}"
    return text.rstrip("0").rstrip(".") if digits > 0 else text


def _more(ratio: float) -> str:
    """Return "2.1 % less" for 0.979."""
    change = abs(ratio - 1.0)
    if change < LEAST_RATIO:
        return "equal"
    return f"{_rounded(100.0 * change, _digits(100.0 * change))} % {'more' if ratio > 1.0 else 'less'}"
