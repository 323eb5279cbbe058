"""One body in several poses: every pose has the same vertices in the same order.

`make_shape` makes another individual each time, and `one_body.make_person` meshes every pose. Here the body
is meshed once, at rest, and skinning moves the mesh with its solids, so vertex i of one pose corresponds to
vertex i of another.
"""

from dataclasses import dataclass
from zlib import crc32

from numpy.random import SeedSequence, default_rng

from core.arrays import Floats, Ints
from core.errors import MeshError, ParameterError
from core.gallery.collection import CLASSES, kind_of, placed
from core.gallery.draws import DRAWS, BodyDraws
from core.gallery.fields import Field
from core.gallery.skinning import skinned, skinning_weights
from core.gallery.surface import surface
from core.gallery.symmetry import symmetric_partners
from core.gallery.topology import components, handles, is_closed_manifold
from core.mesh.mesh import Mesh

VERTICES = 2500
_ATTEMPTS = 25


@dataclass(frozen=True, eq=False)
class Body:
    """An individual of a class, with the data for its poses.

    Attributes
    ----------
    label : str
    rest : Mesh
        The mesh at rest, limbs apart, in the builder's frame: watertight, connected, about 2,500 vertices.
    solids : tuple of Field
        The solids at rest.
    hold : float64, shape (n, number of solids)
        Skinning weights of the vertices; rows sum to 1.
    seeds : tuple of int
        Seeds of the body's random numbers.
    variation : float or None
        See `make_body`.
    """

    label: str
    rest: Mesh
    solids: tuple[Field, ...]
    hold: Floats
    seeds: tuple[int, ...]
    variation: float | None = None

    def partners(self, other: "Body") -> Ints:
        """True correspondences of the vertices on a mesh of the same body, shape (g, n).

        Each row belongs to a symmetry and is a correspondence of two poses, to within half an edge. On the
        same mesh the first row is 0 .. n - 1.
        """
        return symmetric_partners(self.label, self.rest.vertices, other.rest.vertices)

    def posed(self, pose: int) -> Mesh:
        """The body in a pose, with random rotation, scale and position; the faces are those at rest.

        Limbs may intersect, which changes no distance on the surface.

        Raises
        ------
        ParameterError
            The pose is negative.
        """
        if pose < 0:
            raise ParameterError(f"the pose must be at least 0, not {pose}")
        solids = _solids(self, pose)
        moved = skinned(self.rest.vertices, self.hold, self.solids, solids)
        return Mesh(placed(moved, default_rng([*self.seeds, pose, 1])), self.rest.faces)


def make_body(label: str, body: int = 0, *, vertices: int = VERTICES, variation: float | None = None) -> Body:
    """An individual of a class; its proportions depend on the label, the number and the variation only.

    Parameters
    ----------
    label : str
        One of `CLASSES`.
    body : int
        >= 0.
    vertices : int
        Approximate number of vertices, at least some hundreds; another number gives another mesh of the body.
    variation : float, optional
        Coefficient of variation of the proportions, > 0: how much individuals differ, who have the middle
        proportions of their class in the mean. Without it they are drawn from the whole class.

    Raises
    ------
    ParameterError
        The class is unknown or the body is negative.
    """
    if label not in CLASSES:
        raise ParameterError(f"unknown class {label!r}; the classes are {', '.join(CLASSES)}")
    if body < 0:
        raise ParameterError(f"the body must be at least 0, not {body}")
    for attempt in range(_ATTEMPTS):
        seeds = (crc32(label.encode()), body, attempt)
        draws = BodyDraws(DRAWS[label], SeedSequence(seeds), None, variation)
        parts = kind_of(label).build(draws)
        points, faces = surface(parts, vertices)
        if is_closed_manifold(faces) and components(faces) == 1 and handles(faces) == kind_of(label).handles:
            solids = tuple(solid for part in parts for solid in part.fields)
            return Body(
                label=label,
                rest=Mesh(points, faces),
                solids=solids,
                hold=skinning_weights(points, faces, solids),
                seeds=seeds,
                variation=variation,
            )
    raise MeshError(f"no sound body of class {label} in {_ATTEMPTS} draws")


def _solids(body: Body, pose: int) -> list[Field]:
    seeds = SeedSequence(body.seeds), SeedSequence([*body.seeds, pose])
    draws = BodyDraws(DRAWS[body.label], *seeds, body.variation)
    return [solid for part in kind_of(body.label).build(draws) for solid in part.fields]
