"""A vertex for each vertex: spectral correspondence, replaced by registration where the two are rigid copies.

The functional map of `core.dense.functional_maps` pairs all vertices both ways. A vertex whose way
there and back ends far away has no partner: the other surface lacks the place. Where large parts of the two
surfaces are rigid copies, the nearest point after registration is the more exact partner.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.dense.confidence import distortion, spectral_confidence
from core.dense.functional_maps import FINE, basis, compared_rows, functional_map, nearest_both_ways
from core.dense.working_surface import WorkingSurface
from core.embedding import DenseCorrespondence
from core.mesh.box_tree import triangle_tree
from core.mesh.cleaning import vertex_areas
from core.mesh.mesh import Mesh
from core.registration.similarity import NEAR, Similarity, near_rigid
from core.sampling.surface_samples import SurfaceSamples, surface_samples

ASTRAY = 0.1
"""Largest distance of a vertex from itself after the way there and back, over the root of the area."""

ASTRAY_RIGID = 0.03
"""The same between surfaces that are rigid copies in large part, of places that do not coincide."""

LEAST_FOR_A_TURN = 3
"""Landmarks that determine a rotation."""

_LEAST = 1e-3
"""Smallest ratio of lengths: below it a neighbourhood is mapped to a point."""


class _VertexMap(NamedTuple):
    """A vertex of the other surface for each of w vertices, and the way back.

    Each has a confidence in [0, 1], and a stretch as in `stretch`.
    """

    forward: Ints
    confidence: Floats
    stretch: Floats
    backward: Ints


class _Registered(NamedTuple):
    """A working surface of w vertices registered to the other, both at unit area.

    `points` and `moved`, shape (w, 3), are its vertices before and after the transform onto the other
    surface, `gaps` their distances from it, and `coincide` tells whether these are at most `NEAR`. `nearest`
    is the vertex of the other surface nearest to the closest point, and `length` the length, on this working
    surface, of 1 on the other at unit area.
    """

    points: Floats
    moved: Floats
    gaps: Floats
    coincide: NDArray[np.bool_]
    nearest: Ints
    length: float


class Partners(NamedTuple):
    """The partners of w vertices on the other working surface, as in `core.embedding.DenseCorrespondence`."""

    vertices: Ints
    confidence: Floats
    stretch: Floats
    partnered: NDArray[np.bool_]
    displacement: Floats | None


@dataclass(frozen=True, eq=False)
class SurfaceMap:
    """The correspondence of two working surfaces, of n and m vertices.

    Attributes
    ----------
    surfaces : two WorkingSurface
    rows : two float64, shapes (n, k) and (m, k)
        The functions of both in the common spectral domain, and mean curvatures: near each other where the
        surfaces correspond.
    motion : Similarity or None
        Of the first given mesh onto the second, if the two are rigid copies in large part.
    partners : two
        The partners of the vertices of both.
    scale : float
        Length on the second given mesh over length on the first, > 0.
    maps : int
        Different functional maps that fit about equally well, at least 1: more if the shape is symmetric, or
        the shapes are unlike.
    cost : float
        How badly the functional map fits, from about -70 to 100 and more.
    mirrored : bool or None
        Whether the map, or the motion, reverses orientation; None if that is unknown.
    """

    surfaces: tuple[WorkingSurface, WorkingSurface]
    rows: tuple[Floats, Floats]
    motion: Similarity | None
    partners: tuple[Partners, Partners]
    scale: float
    maps: int
    cost: float
    mirrored: bool | None

    def correspondences(self) -> tuple[DenseCorrespondence, DenseCorrespondence]:
        """Return the correspondence of the given meshes, from the first to the second and back."""
        (first, second), (forward, backward) = self.surfaces, self.partners
        return (
            self._on_given(forward, first, second, self.scale),
            self._on_given(backward, second, first, 1.0 / self.scale),
        )

    def _on_given(
        self, partners: Partners, surface: WorkingSurface, other: WorkingSurface, scale: float
    ) -> DenseCorrespondence:
        """Return the correspondence brought from the working surfaces to the given meshes."""
        nearest, displacement = surface.nearest, partners.displacement
        return DenseCorrespondence(
            vertices=other.given[partners.vertices][nearest].astype(np.int32),
            confidence=np.where(partners.partnered, partners.confidence, 0.0)[nearest].astype(np.float32),
            stretch=partners.stretch[nearest].astype(np.float32),
            displacement=None if displacement is None else displacement[nearest].astype(np.float32),
            partnered=partners.partnered[nearest],
            scale=scale,
            maps=self.maps,
            mirrored=self.mirrored,
            simplified=surface.simplified or other.simplified,
        )


def surface_map(
    surfaces: tuple[WorkingSurface, WorkingSurface],
    pairs: Sequence[Ints],
    mirrored: Sequence[bool] | None,
    transform: Similarity | None = None,
    functions: int = FINE,
    landmarks: tuple[Floats, Floats] | None = None,
) -> SurfaceMap:
    """Compute the correspondence of two surfaces.

    Parameters
    ----------
    surfaces : two WorkingSurface
    pairs : sequence of int, shape (p, 2)
        Samples of the first and of the second that correspond, p >= 1, in several ways, best first.
    mirrored : sequence of bool or None
        Which of them reverse orientation, if that is known.
    transform : Similarity or None
        Of the first given mesh onto the second, if it is known.
    functions : int
        Eigenfunctions of the functional map: `FINE`, or `FUNCTIONS` in a third of the time.
    landmarks : two float64, shape (l, 3), or None
        Points of both given meshes that correspond. A motion is kept only if it agrees with them.
    """
    first, second = surfaces
    samples = surface_samples(first.mesh), surface_samples(second.mesh)
    same_units = first.unit * samples[0].unit / (second.unit * samples[1].unit)
    known = _vertices(surfaces, pairs[0])
    held = None
    if landmarks is not None:
        held = np.stack(
            [surface.nearest_vertices(at) for surface, at in zip(surfaces, landmarks, strict=True)], axis=1
        )
        if len(held) >= LEAST_FOR_A_TURN:
            known = held
    units = [surface.to_unit_area(of_one) for surface, of_one in zip(surfaces, samples, strict=True)]

    def agrees(motion: Similarity) -> bool:
        """Tell whether a motion at unit area brings landmarks together."""
        if landmarks is None:
            return True
        ours, theirs = (unit.apply(points) for unit, points in zip(units, landmarks, strict=True))
        return float(np.linalg.norm(motion.apply(ours) - theirs, axis=1).mean()) <= ASTRAY

    motion = None if transform is None else units[0].inverse.then(transform).then(units[1])
    if motion is None or not agrees(motion):
        # Look for a similarity that brings large parts of the surfaces together.
        ends = first.mesh.vertices[known[:, 0]], second.mesh.vertices[known[:, 1]]
        motion = near_rigid(*samples, ends, same_units, sure=known is held)
        motion = motion if motion is not None and agrees(motion) else None

    # Pair all vertices by functional maps.
    bases = basis(first.mesh, functions), basis(second.mesh, functions)
    starts = [_vertices(surfaces, some) for some in pairs]
    domain, count, cost, reverses = functional_map(*bases, starts, mirrored, held)
    rows = compared_rows(*bases, domain)
    maps = _vertex_maps(surfaces, rows, (bases[0].areas, bases[1].areas), cost, count)

    if motion is None:
        forward = _mapped_partners(first, samples[0].unit, maps[0])
        backward = _mapped_partners(second, samples[1].unit, maps[1])
        scale = _scale(surfaces, (forward, backward))
        return SurfaceMap(surfaces, rows, None, (forward, backward), scale, count, cost, reverses)
    registered = _registered(first, second, samples, motion)
    reversed_ = _registered(second, first, samples[::-1], motion.inverse)
    forward = _registered_partners(surfaces, samples[0].unit, maps[0], registered, reversed_)
    backward = _registered_partners(surfaces[::-1], samples[1].unit, maps[1], reversed_, registered)
    whole = units[0].then(motion).then(units[1].inverse)
    reverses = bool(np.linalg.det(motion.rotation) < 0.0)
    scale = motion.scale / same_units
    return SurfaceMap(surfaces, rows, whole, (forward, backward), scale, count, cost, reverses)


def _vertices(surfaces: tuple[WorkingSurface, WorkingSurface], pairs: Ints) -> Ints:
    """Return the vertices of paired samples, shape (p, 2)."""
    return np.stack([surface.samples[pairs[:, side]] for side, surface in enumerate(surfaces)], axis=1)


def _vertex_maps(
    surfaces: tuple[WorkingSurface, WorkingSurface],
    rows: tuple[Floats, Floats],
    areas: tuple[Floats, Floats],
    cost: float,
    count: int,
) -> tuple[_VertexMap, _VertexMap]:
    """Return the maps by nearest neighbours in the common spectral domain, there and back."""
    (first, second), (rotated, functions) = surfaces, rows
    forward, backward = nearest_both_ways(rotated, functions)
    stretches = stretch(first.mesh, second.mesh, forward), stretch(second.mesh, first.mesh, backward)
    whole = cost, distortion(stretches, areas), count
    confidences = (
        spectral_confidence(rotated, functions[forward], *whole),
        spectral_confidence(functions, rotated[backward], *whole),
    )
    return (
        _VertexMap(forward, confidences[0], stretches[0], backward),
        _VertexMap(backward, confidences[1], stretches[1], forward),
    )


def _mapped_partners(surface: WorkingSurface, unit: float, map_: _VertexMap) -> Partners:
    """Return partners by the functional map alone."""
    partnered = _astray(surface, unit, map_) <= ASTRAY
    return Partners(map_.forward, map_.confidence, map_.stretch, partnered, None)


def _registered_partners(
    surfaces: tuple[WorkingSurface, WorkingSurface],
    unit: float,
    map_: _VertexMap,
    registered: _Registered,
    reversed_: _Registered,
) -> Partners:
    """Return partners by registration where the surfaces coincide, by the functional map elsewhere.

    Only a place of the other surface that coincides with none can be the partner of a place that does not.
    """
    surface, other = surfaces
    vertices = np.where(registered.coincide, registered.nearest, map_.forward)
    elsewhere = ~reversed_.coincide[vertices] & (_astray(surface, unit, map_) <= ASTRAY_RIGID)
    far = np.linalg.norm(registered.moved - reversed_.points[vertices], axis=1)
    distances = np.where(elsewhere & ~registered.coincide, far, registered.gaps)
    return Partners(
        vertices=vertices,
        confidence=np.where(registered.coincide, 1.0 - 0.5 * registered.gaps / NEAR, map_.confidence),
        stretch=stretch(surface.mesh, other.mesh, vertices),
        partnered=registered.coincide | elsewhere,
        displacement=distances * registered.length * surface.unit,
    )


def _astray(surface: WorkingSurface, unit: float, map_: _VertexMap) -> Floats:
    """Return the distance of each vertex from itself after the way there and back, at unit area."""
    points = surface.mesh.vertices
    return np.asarray(np.linalg.norm(points - points[map_.backward[map_.forward]], axis=1) / unit)


def _registered(
    surface: WorkingSurface,
    other: WorkingSurface,
    samples: tuple[SurfaceSamples, SurfaceSamples],
    motion: Similarity,
) -> _Registered:
    """Return a surface registered to the other; the samples are those of both."""
    points = samples[0].to_unit(surface.mesh.vertices)
    moved = motion.apply(points)
    corners = samples[1].corners
    shares, faces = triangle_tree(corners).closest(moved)
    closest = np.einsum("nc,ncx->nx", shares, corners[faces])
    gaps = np.linalg.norm(moved - closest, axis=1)
    return _Registered(
        points=points,
        moved=moved,
        gaps=gaps,
        coincide=gaps <= NEAR,
        nearest=np.asarray(cKDTree(samples[1].to_unit(other.mesh.vertices)).query(closest)[1]),
        length=samples[0].unit / motion.scale,
    )


def _scale(surfaces: tuple[WorkingSurface, WorkingSurface], partners: tuple[Partners, Partners]) -> float:
    """Return the root of the ratio of the areas that have a partner; of the whole areas where none has."""
    wholes, parts = [], []
    for surface, own in zip(surfaces, partners, strict=True):
        areas = vertex_areas(surface.mesh.vertices, surface.mesh.faces)
        wholes.append(surface.unit**2 * areas.sum())
        parts.append(surface.unit**2 * (areas * own.partnered).sum())
    first, second = parts if min(parts) > 0.0 else wholes
    return float(np.sqrt(second / first))


def neighbourhoods(mesh: Mesh) -> csr_array:
    """Return 1 for each pair of vertices at most two edges apart, shape (n, n); 0 on the diagonal."""
    edges = mesh.half_edges.edges
    count = len(mesh.vertices)
    upper = csr_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    adjacent = upper + upper.T
    near = csr_array(adjacent + adjacent @ adjacent)
    near.setdiag(0.0)
    near.eliminate_zeros()
    near.data[:] = 1.0
    return near


def stretch(first: Mesh, second: Mesh, partners: Ints) -> Floats:
    """Compute how much a map lengthens each neighbourhood of a surface, over the median.

    Of each vertex and its neighbours up to two edges away, the root of the summed squared distances after the
    map over that before it; the mean of its logarithm over the neighbourhood is returned, since the nearest
    vertex is known to half an edge only.

    Parameters
    ----------
    first, second : Mesh
        Of n and m vertices.
    partners : int64, shape (n,)
        The vertex of the second surface for each vertex of the first.

    Returns
    -------
    float64, shape (n,)
        Length after over length before, over its median; > 0.
    """
    near = neighbourhoods(first).tocoo()
    rows, columns = near.coords
    mapped = second.vertices[partners]
    count = len(first.vertices)

    before, after = (
        np.bincount(rows, ((points[rows] - points[columns]) ** 2).sum(axis=1), count)
        for points in (first.vertices, mapped)
    )
    ratio = np.log(np.maximum(np.sqrt(after / np.maximum(before, np.finfo(float).tiny)), _LEAST))
    valence = np.bincount(rows, minlength=count)
    mean = (ratio + np.bincount(rows, ratio[columns], count)) / (1 + valence)
    return np.asarray(np.exp(mean - np.median(mean)))
