"""Pairs of shapes made by code, each with the likenesses that are right for it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from core.gallery import CLASSES
from core.gallery.bodies import Body, make_body
from core.mesh.mesh import Mesh
from core.ranking.likeness import Likeness
from tests.soak.duplicates.copies import copy, moved

ARTICULATED = ("bird", "fish", "hand", "octopus", "person", "quadruped", "snake", "spider", "teddy")
"""Classes whose poses are far from rigid copies."""

FACTORS = (0.3, 1.5, 2.5, 25.4)
OTHER_MESH = (1800, 3500)
"""Approximate numbers of vertices of other meshes of a body, which has 2,500."""


@dataclass(frozen=True, eq=False)
class PlantedPair:
    """Two meshes, the likenesses of the second to the first that are right, and its scale if it is a copy."""

    kind: str
    name: str
    first: Mesh
    second: Mesh
    right: frozenset[Likeness]
    scale: float | None = None


def planted_pairs(seed: int, shares: dict[str, int]) -> Iterator[PlantedPair]:
    """So many pairs of each kind, of bodies that no other pair has; another seed gives other bodies."""
    body = 1000 * seed
    for kind, count in shares.items():
        plant, labels = KINDS[kind]
        for number in range(count):
            yield plant(labels[number % len(labels)], body)
            body += 1


def turned(label: str, body: int) -> PlantedPair:
    """A copy that is turned and moved."""
    first = make_body(label, body).posed(0)
    return PlantedPair("turned", f"{label}-{body}", first, moved(first, body), frozenset({"same"}), 1.0)


def scaled(label: str, body: int) -> PlantedPair:
    """A copy that is turned, moved and of another size."""
    factor = FACTORS[body % len(FACTORS)]
    first = make_body(label, body).posed(0)
    second = moved(first, body, scale=factor)
    return PlantedPair("scaled", f"{label}-{body}", first, second, frozenset({"scaled"}), factor)


def remeshed(label: str, body: int) -> PlantedPair:
    """A turned copy with split edges, with half of the vertices, or with another mesh of the body."""
    how = ("split", "simplified", "other mesh")[body % 3]
    if how == "other mesh":
        first = make_body(label, body).rest
        second = moved(_other_mesh(label, body).rest, body)
    else:
        first = make_body(label, body).posed(0)
        second = copy(first, how, body)
    return PlantedPair("remeshed", f"{label}-{body}, {how}", first, second, frozenset({"same"}), 1.0)


def mirrored(label: str, body: int) -> PlantedPair:
    """The mirror image, turned. A body that is its own mirror image is the same."""
    first = make_body(label, body).posed(0)
    second = moved(first, body, mirrored=True)
    return PlantedPair("mirrored", f"{label}-{body}", first, second, frozenset({"mirrored", "same"}))


def posed(label: str, body: int) -> PlantedPair:
    """Another pose, on another mesh, of another size."""
    first, second = make_body(label, body).posed(0), _other_mesh(label, body).posed(1)
    return PlantedPair("posed", f"{label}-{body}", first, second, frozenset({"pose"}))


def individual(label: str, body: int) -> PlantedPair:
    """Another individual of the class, in another pose."""
    first, second = make_body(label, body).posed(0), _other_mesh(label, body + 500).posed(1)
    return PlantedPair("another individual", f"{label}-{body}", first, second, frozenset({"similar"}))


def other_class(label: str, body: int) -> PlantedPair:
    """A body of another class."""
    step = 1 + body % (len(CLASSES) - 1)
    other = CLASSES[(CLASSES.index(label) + step) % len(CLASSES)]
    first, second = make_body(label, body).posed(0), make_body(other, body).posed(1)
    return PlantedPair("another class", f"{label} {other} {body}", first, second, frozenset({"weak"}))


def _other_mesh(label: str, body: int) -> Body:
    return make_body(label, body, vertices=OTHER_MESH[body % 2])


KINDS: dict[str, tuple[Callable[[str, int], PlantedPair], tuple[str, ...]]] = {
    "turned": (turned, CLASSES),
    "scaled": (scaled, CLASSES),
    "remeshed": (remeshed, CLASSES),
    "mirrored": (mirrored, CLASSES),
    "posed": (posed, ARTICULATED),
    "another individual": (individual, CLASSES),
    "another class": (other_class, CLASSES),
}
