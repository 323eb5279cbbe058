"""Near-identical pairs: the search for them, the criteria of a report, and the groups that pairs join."""

from collections import deque
from collections.abc import Set
from dataclasses import dataclass

from core.ranking.likeness import Copy, copy_likeness
from core.registration.similarity import RESIDUAL


@dataclass(frozen=True)
class Link:
    """Two near-identical shapes, by number; lengths in the second are `scale` times those in the first.

    A `variant` differs locally.
    """

    first: int
    second: int
    cc: float
    residual: float
    scale: float
    mirrored: bool
    variant: bool = False


@dataclass(frozen=True)
class Search:
    """A search for copies, or for copies and variants, by one pipeline, and the bounds of its pairs."""

    fingerprint: str
    variants: bool
    max_residual: float = RESIDUAL


@dataclass(frozen=True)
class GroupMember:
    """A shape of a group, its relation to the first shape, and the cc and residual of its link."""

    shape: int
    likeness: Copy
    scale: float
    cc: float
    residual: float


class Groups:
    """Connected components that grow by one link at a time."""

    def __init__(self) -> None:
        self._parents: dict[int, int] = {}
        self._links: dict[int, list[Link]] = {}

    def joined(self, first: int, second: int) -> bool:
        """Return whether copies join two shapes; a variant of a variant may be a copy."""
        return self._root(first) == self._root(second)

    def join(self, link: Link) -> None:
        """Join the groups of two shapes, which must differ."""
        if not link.variant:
            self._parents[self._root(link.first)] = self._root(link.second)
        self._links.setdefault(link.first, []).append(link)
        self._links.setdefault(link.second, []).append(link)

    def members(self, shown: Set[int]) -> list[list[GroupMember]]:
        """Return some shapes in groups of two or more; groups and their members are sorted by number.

        Scale, mirroring and local differences of a member are composed along the links from the first shown
        shape of its group; links through shapes that are not shown count too.
        """
        done: set[int] = set()
        groups = []
        for shape in sorted(shown & self._links.keys()):
            if shape not in done:
                group = [member for member in self._from(shape) if member.shape in shown]
                done |= {member.shape for member in group}
                groups.append(group)
        return [group for group in groups if len(group) > 1]

    def _root(self, shape: int) -> int:
        while (parent := self._parents.get(shape, shape)) != shape:
            self._parents[shape] = self._parents.get(parent, parent)
            shape = parent
        return shape

    def _from(self, first: int) -> list[GroupMember]:
        """Return the group of a shape; the path to a member has as few variants as possible."""
        members: dict[int, GroupMember] = {}
        pending = deque([(GroupMember(first, "same", 1.0, 1.0, 0.0), False, False)])
        while pending:
            member, mirrored, variant = pending.popleft()
            if member.shape in members:
                continue
            members[member.shape] = member
            for link in self._links[member.shape]:
                forward = link.first == member.shape
                shape = link.second if forward else link.first
                scale = member.scale * (link.scale if forward else 1.0 / link.scale)
                reflected, differs = mirrored != link.mirrored, variant or link.variant
                likeness = copy_likeness(scale, mirrored=reflected, variant=differs)
                neighbour = GroupMember(shape, likeness, scale, link.cc, link.residual)
                (pending.append if link.variant else pending.appendleft)((neighbour, reflected, differs))
        return [members[shape] for shape in sorted(members)]
