"""The random numbers of a builder: those of the body, and those of its pose.

A builder draws its numbers one by one and always in the same order, so a class is described by a string
with a letter a draw: `b` belongs to the body, `p` to the pose, and `m` is a length that the builder draws
for each side, taken from the middle of its range so that the body is as symmetric as its class. All draws
after the last letter are of the pose.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from numpy.random import PCG64, Generator, SeedSequence


@dataclass(frozen=True)
class Draws:
    """The random numbers of a class.

    Attributes
    ----------
    kinds : str
        One letter for each number, as the module describes.
    rest : mapping of int to float
        Values in the rest pose, by index, where the rule of `at_rest` would not separate the limbs.
    """

    kinds: str
    rest: Mapping[int, float] = field(default_factory=dict)


DRAWS: Mapping[str, Draws] = {
    "bird": Draws("bbbpppp" + "bb" + "p" + "bbbpp" + "ppppm" + "ppppm"),
    "chair": Draws("bbbbb" + "p" + "bbb" + "p"),
    "cup": Draws("b" * 9),
    "fish": Draws("bb" + "p" * 7 + "bb" + "p" + "bb"),
    "glasses": Draws("bbbbb" + "p" + "pmm" + "pmm"),
    "hand": Draws("bb", rest={5: 0.0}),
    "octopus": Draws("bb" + "pp" + "b" + "ppmppp" * 8),
    "person": Draws("b" * 5),
    "plane": Draws("bbbbbb" + "p" + "b" * 5),
    "pliers": Draws("p" + "b" * 5),
    "quadruped": Draws("bbb" + "pppp" + "b" + "pp" + "bb" + "p" * 12 + "b"),
    "snake": Draws("bb", rest={3: 0.0, 7: 0.0}),
    "spider": Draws("b" + "pp" + "bbbb"),
    "teddy": Draws("bb" + "ppp" + "b" + "ppmppppmp" * 2),
}


def at_rest(low: float, high: float) -> float:
    """A pose's number at rest: 0 if the range contains it, else the middle of the range."""
    return 0.0 if low < 0.0 < high else 0.5 * (low + high)


class BodyDraws(Generator):
    """Random numbers of a builder: one stream for the body, and another one, or rest values, for the pose.

    Parameters
    ----------
    draws : Draws
    body : SeedSequence
    pose : SeedSequence, optional
        None gives the rest pose.
    variation : float, optional
        If given, the body's numbers are the middles of their ranges times normal numbers of mean 1 and this
        standard deviation: similar individuals instead of individuals from the whole class.
    """

    def __init__(
        self, draws: Draws, body: SeedSequence, pose: SeedSequence | None, variation: float | None = None
    ) -> None:
        super().__init__(PCG64(body))
        self._draws = draws
        self._variation = variation
        self._pose = None if pose is None else Generator(PCG64(pose))
        self._place = 0

    def uniform(self, low: float = 0.0, high: float = 1.0) -> float:  # type: ignore[override]
        """The next number, uniform in [low, high) unless the body has a variation."""
        place, self._place = self._place, self._place + 1
        kind = self._draws.kinds[place] if place < len(self._draws.kinds) else "p"
        if kind == "b" and self._variation is not None:
            return 0.5 * (low + high) * super().normal(1.0, self._variation)
        if kind == "b":
            return super().uniform(low, high)
        if kind == "m":
            return 0.5 * (low + high)
        if self._pose is not None:
            return self._pose.uniform(low, high)
        return self._draws.rest.get(place, at_rest(low, high))
