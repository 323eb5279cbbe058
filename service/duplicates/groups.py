"""Near-identical pairs: the search for them, the criteria of a report, and the groups that pairs join."""

from collections import deque
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from core.ranking.likeness import Copy, copy_likeness
from core.registration.similarity import RESIDUAL
from service.duplicates.records import Decision, Pair, pair_of
from service.search.local_difference import LocalDifference


@dataclass(frozen=True)
class Link:
    """Two near-identical shapes, by number; lengths in the second are `scale` times those in the first.

    A `variant` differs locally: `difference` has the fields of a `LocalDifference` in the coordinates of the
    first.
    """

    first: int
    second: int
    cc: float
    residual: float
    scale: float
    mirrored: bool
    variant: bool = False
    difference: dict[str, Any] | None = None


@dataclass(frozen=True)
class Search:
    """A search for copies, or for copies and variants, by one pipeline, and the bounds of its pairs."""

    fingerprint: str
    variants: bool
    max_residual: float = RESIDUAL


@dataclass(frozen=True)
class Counted:
    """Which copies count besides undecided ones of one size: scaled ones, mirror images, and decided ones."""

    scaled: bool = False
    mirrored: bool = True
    decided: bool = False


@dataclass(frozen=True)
class GroupMember:
    """A shape of a group, its relation to the first shape, and the cc and residual of its last link.

    `mirrored` tells whether it is a mirror image of the first shape or a variant of one. The `difference` of
    a variant is that from the shape `compared_with`: the first shape if a link joins the two. It is in the
    coordinates and units of the older of the two.
    """

    shape: int
    likeness: Copy = "same"
    scale: float = 1.0
    cc: float = 1.0
    residual: float = 0.0
    mirrored: bool = False
    difference: LocalDifference | None = None
    compared_with: int | None = None


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

    def members(self, shown: Set[int], counted: Counted) -> list[list[GroupMember]]:
        """Return some shapes in groups of two or more; groups and their members are sorted by number.

        Scale, mirroring and local differences of a member are composed along the links from the first shape
        of its group; links through shapes that are not shown, or do not count, count too.
        """
        done: set[int] = set()
        groups = []
        for shape in sorted(shown & self._links.keys()):
            if shape not in done:
                joined = [member for member in self._from(shape) if member.shape in shown]
                done |= {member.shape for member in joined}
                groups += self._counted(joined, counted)
        return sorted(groups, key=lambda group: group[0].shape)

    def _counted(self, joined: list[GroupMember], counted: Counted) -> list[list[GroupMember]]:
        """Return the groups of two or more, by size and hand, of shapes that links join."""
        groups = []
        while len(joined) > 1:
            first = joined[0]
            alike = {
                member.shape
                for member in joined
                if (counted.scaled or copy_likeness(member.scale / first.scale, mirrored=False) == "same")
                and (counted.mirrored or member.mirrored == first.mirrored)
            }
            if len(alike) > 1:
                groups.append([member for member in self._from(first.shape) if member.shape in alike])
            joined = [member for member in joined if member.shape not in alike]
        return groups

    def _root(self, shape: int) -> int:
        while (parent := self._parents.get(shape, shape)) != shape:
            self._parents[shape] = self._parents.get(parent, parent)
            shape = parent
        return shape

    def _from(self, first: int) -> list[GroupMember]:
        """Return the group of a shape; the path to a member has as few variants as possible."""
        members: dict[int, GroupMember] = {}
        pending = deque([GroupMember(first)])
        while pending:
            member = pending.popleft()
            if member.shape in members:
                continue
            members[member.shape] = member
            for link in self._links[member.shape]:
                (pending.append if link.variant else pending.appendleft)(_neighbour(member, link))
        return [members[shape] for shape in sorted(members)]


def _neighbour(member: GroupMember, link: Link) -> GroupMember:
    """Return the other shape of a link of a member, relative to the first shape of its group."""
    forward = link.first == member.shape
    scale = member.scale * (link.scale if forward else 1.0 / link.scale)
    mirrored = member.mirrored != link.mirrored
    shape = link.second if forward else link.first
    difference, compared_with = _of_copy(member, shape, scale / member.scale), member.compared_with
    if link.difference is not None:
        difference = LocalDifference.model_validate({**link.difference, "scale": link.scale})
        difference, compared_with = difference if forward else difference.reverse(), member.shape
    return GroupMember(
        shape=shape,
        likeness=copy_likeness(
            scale, mirrored=mirrored, variant=link.variant or member.likeness == "variant"
        ),
        scale=scale,
        cc=link.cc,
        residual=link.residual,
        mirrored=mirrored,
        difference=difference,
        compared_with=compared_with,
    )


def _of_copy(member: GroupMember, copy: int, scale: float) -> LocalDifference | None:
    """Return the difference of a copy of a member, `scale` times as large, from the shape compared with.

    Links have no transforms: coordinates of the member are left out.
    """
    if member.difference is None or member.compared_with is None:
        return None
    other = member.compared_with
    difference = member.difference.model_copy(update={"scale": scale * member.difference.scale})
    before, after = min(member.shape, other), min(copy, other)
    if before == after:
        return difference
    sizes = {other: 1.0, member.shape: member.difference.scale, copy: difference.scale}
    return difference.without_place(sizes[after] / sizes[before])


def undecided(
    groups: Sequence[Sequence[int]], files: Mapping[int, str], decided: Mapping[Pair, Decision]
) -> Set[int]:
    """Return the shapes of groups, by number, that form an undecided pair with another one of their group."""
    return {
        shape
        for group in groups
        for pair in combinations(group, 2)
        if pair_of(files[pair[0]], files[pair[1]]) not in decided
        for shape in pair
    }
