"""One body in several poses: every pose has the same vertices in the same order.

`make_shape` gives another individual each time, and `one_body.make_person` meshes each pose anew. Here the
body is meshed once, at rest, and the mesh follows the solids that it was made of, so that vertex i of one
pose is known to be vertex i of another.
"""

from dataclasses import dataclass
from zlib import crc32

from numpy.random import SeedSequence, default_rng

from core.arrays import Floats, Ints
from core.errors import MeshError, ParameterError
from core.gallery.collection import CLASSES, kind_of, placed
from core.gallery.draws import DRAWS, BodyDraws
from core.gallery.fields import Field
from core.gallery.skinning import skinned, weights
from core.gallery.surface import surface
from core.gallery.symmetry import symmetric_partners
from core.gallery.topology import components, handles, is_closed_manifold
from core.mesh.mesh import Mesh

VERTICES = 2500
_ATTEMPTS = 25


@dataclass(frozen=True, eq=False)
class Body:
    """An individual of a class, and what its poses are made from.

    Attributes
    ----------
    label : str
    rest : Mesh
        Limbs apart, in the builder's own frame: watertight, in one piece, about 2,500 vertices.
    solids : tuple of Field
        At rest.
    hold : float64, shape (n, number of solids)
        How much each moves each vertex.
    seeds : tuple of int
        Of the body's own draws.
    """

    label: str
    rest: Mesh
    solids: tuple[Field, ...]
    hold: Floats
    seeds: tuple[int, ...]

    def partners(self, other: "Body") -> Ints:
        """The true partners of its vertices on a mesh of the same body, shape (g, n): a row a symmetry.

        Two poses correspond by any row as well as by the first, to within half an edge. On the same mesh the
        first row is 0 .. n - 1.
        """
        return symmetric_partners(self.label, self.rest.vertices, other.rest.vertices)

    def posed(self, pose: int) -> Mesh:
        """The body in one of its poses, turned, scaled and placed at random too; the faces are those at rest.

        Limbs may pass through each other: what is near in space alone changes no distance along the surface.

        Raises
        ------
        ParameterError
            A negative pose.
        """
        if pose < 0:
            raise ParameterError(f"the pose must be at least 0, not {pose}")
        solids = _solids(self.label, self.seeds, pose)
        moved = skinned(self.rest.vertices, self.hold, self.solids, solids)
        return Mesh(placed(moved, default_rng([*self.seeds, pose, 1])), self.rest.faces)


def make_body(label: str, body: int = 0, *, vertices: int = VERTICES) -> Body:
    """An individual of a class, with proportions drawn from the two arguments alone.

    Parameters
    ----------
    label : str
        One of `CLASSES`.
    body : int
        >= 0.
    vertices : int
        About how many the mesh has, some hundreds at least; another number is another mesh of the same body.

    Raises
    ------
    ParameterError
        An unknown class, or a negative body.
    """
    if label not in CLASSES:
        raise ParameterError(f"unknown class {label!r}; the classes are {', '.join(CLASSES)}")
    if body < 0:
        raise ParameterError(f"the body must be at least 0, not {body}")
    for attempt in range(_ATTEMPTS):
        seeds = (crc32(label.encode()), body, attempt)
        draws = BodyDraws(DRAWS[label], SeedSequence(seeds), None)
        parts = kind_of(label).build(draws)
        points, faces = surface(parts, vertices)
        if is_closed_manifold(faces) and components(faces) == 1 and handles(faces) == kind_of(label).handles:
            solids = tuple(solid for part in parts for solid in part.fields)
            return Body(
                label=label,
                rest=Mesh(points, faces),
                solids=solids,
                hold=weights(points, faces, solids),
                seeds=seeds,
            )
    raise MeshError(f"no sound body of class {label} in {_ATTEMPTS} draws")


def _solids(label: str, seeds: tuple[int, ...], pose: int) -> list[Field]:
    draws = BodyDraws(DRAWS[label], SeedSequence(seeds), SeedSequence([*seeds, pose]))
    return [solid for part in kind_of(label).build(draws) for solid in part.fields]
