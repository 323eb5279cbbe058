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
from core.dense.functional_maps import FINE, Basis, basis, functional_map, nearest_both_ways
from core.embedding import DenseCorrespondence
from core.mesh.box_tree import triangle_tree
from core.mesh.cleaning import vertex_areas
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import NormalFrame
from core.mesh.simplification import simplify
from core.registration.similarity import NEAR, Similarity, near_rigid, to_unit_area
from core.sampling.surface_samples import SurfaceSamples, surface_samples

ASTRAY = 0.1
"""Largest distance of a vertex from itself after the way there and back, over the root of the area."""

ASTRAY_RIGID = 0.03
"""The same between surfaces that are rigid copies in large part, of places that do not coincide."""

MOST_VERTICES, SIMPLIFIED = 6000, 5000
"""A surface with more than `MOST_VERTICES` vertices is simplified to about `SIMPLIFIED`: time and memory of a
correspondence grow with the product of the two numbers of vertices."""

_LEAST = 1e-3
"""Smallest ratio of lengths: below it a neighbourhood is mapped to a point."""


@dataclass(frozen=True, eq=False)
class WorkingSurface:
    """A surface of w vertices that stands for a mesh of n vertices.

    Attributes
    ----------
    mesh : Mesh
        The surface, clean, in its normal frame.
    frame : NormalFrame
        From the given mesh to the surface.
    nearest : int64, shape (n,)
        The vertex of the surface nearest to each vertex of the given mesh.
    given : int64, shape (w,)
        The vertex of the given mesh nearest to each vertex of the surface; it has a face.
    samples : int64, shape (m,)
        The vertex of the surface nearest to each sample of the embedding.
    simplified : bool
    """

    mesh: Mesh
    frame: NormalFrame
    nearest: Ints
    given: Ints
    samples: Ints
    simplified: bool

    @property
    def unit(self) -> float:
        """Length 1 of the surface in units of the given mesh, > 0."""
        return self.frame.scale

    def to_unit_area(self, samples: SurfaceSamples) -> Similarity:
        """Return the transform from the given mesh to unit area; the samples are those of the surface."""
        turn, centre, scale = self.frame.axes, self.frame.centre, self.frame.scale
        return Similarity(1.0 / scale, turn, -turn @ centre / scale).then(to_unit_area(samples))


def working_surface(given: Mesh, surface: Mesh, frame: NormalFrame, samples: Floats) -> WorkingSurface:
    """Return the working surface of a mesh.

    Parameters
    ----------
    given : Mesh
        As it was read, with n vertices.
    surface : Mesh
        The same, clean, in its normal frame, its holes filled, refined, perhaps simplified.
    frame : NormalFrame
        From the given mesh to the surface.
    samples : float, shape (m, 3)
        Positions of the samples of the embedding, in the frame of the given mesh.
    """
    simplified = len(surface.vertices) < len(given.vertices) and len(given.vertices) > MOST_VERTICES
    if len(surface.vertices) > MOST_VERTICES:
        surface, simplified = simplify(surface, SIMPLIFIED), True
    placed = frame.apply(given.vertices)
    used = np.zeros(len(placed), dtype=bool)
    used[given.faces.ravel()] = True
    used_vertices = np.flatnonzero(used)
    tree = cKDTree(surface.vertices)
    back = cKDTree(placed[used_vertices]).query(surface.vertices)[1]
    return WorkingSurface(
        mesh=surface,
        frame=frame,
        nearest=np.asarray(tree.query(placed)[1], dtype=np.int64),
        given=used_vertices[back],
        samples=np.asarray(tree.query(frame.apply(samples))[1], dtype=np.int64),
        simplified=simplified,
    )


class _VertexMap(NamedTuple):
    """A vertex of the other surface for each of w vertices, with a confidence in [0, 1], and the way back."""

    forward: Ints
    confidence: Floats
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


class _Partners(NamedTuple):
    """The partners of w vertices on the other working surface, as in `core.embedding.DenseCorrespondence`."""

    vertices: Ints
    confidence: Floats
    partnered: NDArray[np.bool_]
    displacement: Floats | None


def correspond(
    surfaces: tuple[WorkingSurface, WorkingSurface],
    pairs: Sequence[Ints],
    mirrored: bool | None,
    transform: Similarity | None = None,
    functions: int = FINE,
) -> tuple[DenseCorrespondence, DenseCorrespondence]:
    """Compute the correspondence from the first surface to the second, and from the second to the first.

    Parameters
    ----------
    surfaces : two WorkingSurface
    pairs : sequence of int, shape (p, 2)
        Samples of the first and of the second that correspond, p >= 1, in several ways, best first.
    mirrored : bool or None
        Whether they reverse orientation, if that is known.
    transform : Similarity or None
        Of the first given mesh onto the second, if it is known.
    functions : int
        Eigenfunctions of the functional map: `FINE`, or `FUNCTIONS` in a third of the time.
    """
    first, second = surfaces
    samples = surface_samples(first.mesh), surface_samples(second.mesh)
    same_units = first.unit * samples[0].unit / (second.unit * samples[1].unit)
    if transform is None:
        # Look for a similarity that brings large parts of the surfaces together.
        known = _vertices(surfaces, pairs[0])
        ends = first.mesh.vertices[known[:, 0]], second.mesh.vertices[known[:, 1]]
        motion = near_rigid(*samples, ends, same_units)
    else:
        units = [surface.to_unit_area(of_one) for surface, of_one in zip(surfaces, samples, strict=True)]
        motion = units[0].inverse.then(transform).then(units[1])

    # Pair all vertices by functional maps.
    bases = basis(first.mesh, functions), basis(second.mesh, functions)
    maps = _vertex_maps(*bases, [_vertices(surfaces, some) for some in pairs], mirrored)

    if motion is None:
        forward = _mapped_partners(first, samples[0].unit, maps[0])
        backward = _mapped_partners(second, samples[1].unit, maps[1])
        scale = _scale(surfaces, (forward, backward))
    else:
        registered = _registered(first, second, samples, motion)
        reversed_ = _registered(second, first, samples[::-1], motion.inverse)
        forward = _registered_partners(first, samples[0].unit, maps[0], registered, reversed_)
        backward = _registered_partners(second, samples[1].unit, maps[1], reversed_, registered)
        scale = motion.scale / same_units
    return _on_given(forward, first, second, scale), _on_given(backward, second, first, 1.0 / scale)


def _vertices(surfaces: tuple[WorkingSurface, WorkingSurface], pairs: Ints) -> Ints:
    """Return the vertices of paired samples, shape (p, 2)."""
    return np.stack([surface.samples[pairs[:, side]] for side, surface in enumerate(surfaces)], axis=1)


def _vertex_maps(
    first: Basis, second: Basis, pairs: Sequence[Ints], mirrored: bool | None
) -> tuple[_VertexMap, _VertexMap]:
    """Return the maps by nearest neighbours in the spectral domain, there and back."""
    rotation = functional_map(first, second, pairs, mirrored)
    size = len(rotation)
    rotated, functions = first.functions[:, :size] @ rotation, second.functions[:, :size]
    forward, backward = nearest_both_ways(rotated, functions)
    return (
        _VertexMap(forward, _confidence(rotated, functions[forward]), backward),
        _VertexMap(backward, _confidence(functions, rotated[backward]), forward),
    )


def _confidence(rows: Floats, partners: Floats) -> Floats:
    """Return 1 where two rows coincide, 0 where they are orthogonal or worse: half their distance squared."""
    lengths = np.einsum("ij,ij->i", rows, rows) + np.einsum("ij,ij->i", partners, partners)
    squares = ((rows - partners) ** 2).sum(axis=1)
    return np.asarray(np.clip(1.0 - squares / lengths, 0.0, 1.0))


def _mapped_partners(surface: WorkingSurface, unit: float, map_: _VertexMap) -> _Partners:
    """Return partners by the functional map alone."""
    return _Partners(map_.forward, map_.confidence, _astray(surface, unit, map_) <= ASTRAY, None)


def _registered_partners(
    surface: WorkingSurface, unit: float, map_: _VertexMap, registered: _Registered, reversed_: _Registered
) -> _Partners:
    """Return partners by registration where the surfaces coincide, by the functional map elsewhere.

    Only a place of the other surface that coincides with none can be the partner of a place that does not.
    """
    vertices = np.where(registered.coincide, registered.nearest, map_.forward)
    elsewhere = ~reversed_.coincide[vertices] & (_astray(surface, unit, map_) <= ASTRAY_RIGID)
    far = np.linalg.norm(registered.moved - reversed_.points[vertices], axis=1)
    distances = np.where(elsewhere & ~registered.coincide, far, registered.gaps)
    return _Partners(
        vertices=vertices,
        confidence=np.where(registered.coincide, 1.0 - 0.5 * registered.gaps / NEAR, map_.confidence),
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


def _scale(surfaces: tuple[WorkingSurface, WorkingSurface], partners: tuple[_Partners, _Partners]) -> float:
    """Return the root of the ratio of the areas that have a partner; of the whole areas where none has."""
    wholes, parts = [], []
    for surface, own in zip(surfaces, partners, strict=True):
        areas = vertex_areas(surface.mesh.vertices, surface.mesh.faces)
        wholes.append(surface.unit**2 * areas.sum())
        parts.append(surface.unit**2 * (areas * own.partnered).sum())
    first, second = parts if min(parts) > 0.0 else wholes
    return float(np.sqrt(second / first))


def _on_given(
    partners: _Partners, surface: WorkingSurface, other: WorkingSurface, scale: float
) -> DenseCorrespondence:
    """Return the correspondence brought from the working surfaces to the given meshes."""
    nearest, displacement = surface.nearest, partners.displacement
    return DenseCorrespondence(
        vertices=other.given[partners.vertices][nearest].astype(np.int32),
        confidence=np.where(partners.partnered, partners.confidence, 0.0)[nearest].astype(np.float32),
        stretch=stretch(surface.mesh, other.mesh, partners.vertices)[nearest].astype(np.float32),
        displacement=None if displacement is None else displacement[nearest].astype(np.float32),
        partnered=partners.partnered[nearest],
        scale=scale,
        simplified=surface.simplified or other.simplified,
    )


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
