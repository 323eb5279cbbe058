"""Groups of shapes from the pairs that are near-identical."""

from collections import deque
from dataclasses import dataclass

from core.registration.similarity_icp import Kinship, kinship


@dataclass(frozen=True)
class Link:
    """Two shapes by number, found near-identical: lengths in the second are `scale` times the first's."""

    first: int
    second: int
    cc: float
    residual: float
    scale: float
    mirrored: bool


@dataclass(frozen=True)
class Member:
    """A shape of a group, what it is to the group's first, and the cc and residual that it was found by."""

    shape: int
    kinship: Kinship
    scale: float
    cc: float
    residual: float


class Groups:
    """Connected components, which grow by a link at a time."""

    def __init__(self) -> None:
        self._parents: dict[int, int] = {}
        self._links: dict[int, list[Link]] = {}

    def joined(self, first: int, second: int) -> bool:
        """Whether two shapes are in one group already."""
        return self._root(first) == self._root(second)

    def join(self, link: Link) -> None:
        """Have the two of a link, which are not joined, and all that is joined to either in one group."""
        self._parents[self._root(link.first)] = self._root(link.second)
        self._links.setdefault(link.first, []).append(link)
        self._links.setdefault(link.second, []).append(link)

    def members(self) -> list[list[Member]]:
        """Every group of two or more, each and all in the order of their numbers.

        Scales and mirrorings are those along the links from the first of a group.
        """
        done: set[int] = set()
        groups = []
        for shape in sorted(self._links):
            if shape not in done:
                group = self._from(shape)
                done |= {member.shape for member in group}
                groups.append(group)
        return groups

    def _root(self, shape: int) -> int:
        while (parent := self._parents.get(shape, shape)) != shape:
            self._parents[shape] = self._parents.get(parent, parent)
            shape = parent
        return shape

    def _from(self, first: int) -> list[Member]:
        mirrored = {first: False}
        found = {first: Member(first, "same", 1.0, 1.0, 0.0)}
        pending = deque([first])
        while pending:
            here = pending.popleft()
            for link in self._links[here]:
                forth = link.first == here
                other = link.second if forth else link.first
                if other in found:
                    continue
                scale = found[here].scale * (link.scale if forth else 1.0 / link.scale)
                mirrored[other] = mirrored[here] != link.mirrored
                kind = kinship(scale, mirrored=mirrored[other])
                found[other] = Member(other, kind, scale, link.cc, link.residual)
                pending.append(other)
        return [found[shape] for shape in sorted(found)]
