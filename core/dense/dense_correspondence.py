"""A vertex for each vertex: spectral correspondence, replaced by registration where the two are rigid copies.

The functional map of `core.dense.functional_maps` pairs all vertices both ways. A vertex whose way
there and back ends far away has no partner: the other surface lacks the place. Where large parts of the two
surfaces are rigid copies, the nearest point after registration is the more exact partner.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.dense.functional_maps import Basis, basis, functional_map, nearest_both_ways
from core.dense.records import DenseCorrespondence
from core.dense.stretch import stretch
from core.dense.working_surface import WorkingSurface
from core.mesh.cleaning import vertex_areas
from core.registration.similarity import NEAR, Similarity, near_rigid
from core.sampling.surface_samples import SurfaceSamples, closest_points, surface_samples

ASTRAY = 0.1
"""Largest distance of a vertex from itself after the way there and back, over the root of the area."""

ASTRAY_RIGID = 0.03
"""The same between surfaces that are rigid copies in large part, of places that do not coincide."""


@dataclass(frozen=True, eq=False)
class _Way:
    """One direction of the map between working surfaces."""

    there: Ints
    confidence: Floats
    back: Ints


@dataclass(frozen=True, eq=False)
class _Registered:
    """A working surface of w vertices registered to the other, both at unit area.

    Attributes
    ----------
    points, moved : float64, shape (w, 3)
        Its vertices, before and after the transform onto the other surface.
    gaps : float64, shape (w,)
        Their distances from the other surface.
    coincide : bool, shape (w,)
        Whether these are at most `NEAR`.
    nearest : int64, shape (w,)
        The vertex of the other surface nearest to the closest point on it.
    length : float
        The length, on this working surface, of 1 on the other at unit area.
    """

    points: Floats
    moved: Floats
    gaps: Floats
    coincide: NDArray[np.bool_]
    nearest: Ints
    length: float


@dataclass(frozen=True, eq=False)
class _Seen:
    """A working surface as it corresponds to the other; the displacement is in units of its given mesh."""

    there: Ints
    confidence: Floats
    partnered: NDArray[np.bool_]
    displacement: Floats | None


def correspond(
    first: WorkingSurface, second: WorkingSurface, pairs: Sequence[Ints], mirrored: bool | None
) -> tuple[DenseCorrespondence, DenseCorrespondence]:
    """Return the correspondence from the first shape to the second, and from the second to the first.

    Parameters
    ----------
    first, second : WorkingSurface
    pairs : sequence of int, shape (p, 2)
        Samples of the first and of the second that correspond, p >= 1, in several ways, best first.
    mirrored : bool or None
        Whether they reverse orientation, if that is known.
    """
    ways = _both_ways(
        basis(first.mesh), basis(second.mesh), [_vertices(first, second, one) for one in pairs], mirrored
    )
    known = _vertices(first, second, pairs[0])
    sides = surface_samples(first.mesh), surface_samples(second.mesh)
    ends = first.mesh.vertices[known[:, 0]], second.mesh.vertices[known[:, 1]]
    same_units = first.unit * sides[0].unit / (second.unit * sides[1].unit)
    motion = near_rigid(*sides, ends, same_units)
    if motion is None:
        ahead = _seen_from(first, sides[0].unit, ways[0])
        behind = _seen_from(second, sides[1].unit, ways[1])
        scale = _scale(first, second, ahead, behind)
    else:
        own = _registered(first, second, sides, motion)
        opposite = _registered(second, first, sides[::-1], _inverse(motion))
        ahead = _registered_from(first, sides[0].unit, ways[0], own, opposite)
        behind = _registered_from(second, sides[1].unit, ways[1], opposite, own)
        scale = motion.scale / same_units
    return _of_given(ahead, first, second, scale), _of_given(behind, second, first, 1.0 / scale)


def _vertices(first: WorkingSurface, second: WorkingSurface, pairs: Ints) -> Ints:
    """Return the vertices of paired samples, shape (p, 2)."""
    return np.stack([first.samples[pairs[:, 0]], second.samples[pairs[:, 1]]], axis=1)


def _both_ways(
    first: Basis, second: Basis, pairs: Sequence[Ints], mirrored: bool | None
) -> tuple[_Way, _Way]:
    rotation = functional_map(first, second, pairs, mirrored)
    size = len(rotation)
    ours, theirs = first.functions[:, :size] @ rotation, second.functions[:, :size]
    there, back = nearest_both_ways(ours, theirs)
    return (
        _Way(there, _confidence(ours, theirs[there]), back),
        _Way(back, _confidence(theirs, ours[back]), there),
    )


def _confidence(rows: Floats, found: Floats) -> Floats:
    """1 where the two rows coincide, 0 where they are orthogonal or worse: half their distance squared."""
    lengths = np.einsum("ij,ij->i", rows, rows) + np.einsum("ij,ij->i", found, found)
    squares = ((rows - found) ** 2).sum(axis=1)
    return np.asarray(np.clip(1.0 - squares / lengths, 0.0, 1.0))


def _seen_from(here: WorkingSurface, unit: float, way: _Way) -> _Seen:
    """Return a side by the functional map alone."""
    return _Seen(way.there, way.confidence, _astray(here, unit, way) <= ASTRAY, None)


def _registered_from(
    here: WorkingSurface, unit: float, way: _Way, own: _Registered, opposite: _Registered
) -> _Seen:
    """Return a side by registration where the surfaces coincide, by the functional map elsewhere.

    Only a place of the other surface that coincides with none can be the partner of a place that does not.
    """
    there = np.where(own.coincide, own.nearest, way.there)
    elsewhere = ~opposite.coincide[there] & (_astray(here, unit, way) <= ASTRAY_RIGID)
    far = np.linalg.norm(own.moved - opposite.points[there], axis=1)
    distances = np.where(elsewhere & ~own.coincide, far, own.gaps)
    return _Seen(
        there=there,
        confidence=np.where(own.coincide, 1.0 - 0.5 * own.gaps / NEAR, way.confidence),
        partnered=own.coincide | elsewhere,
        displacement=distances * own.length * here.unit,
    )


def _astray(here: WorkingSurface, unit: float, way: _Way) -> Floats:
    """Distance of each vertex from itself after the way there and back, at unit area."""
    points = here.mesh.vertices
    return np.asarray(np.linalg.norm(points - points[way.back[way.there]], axis=1) / unit)


def _registered(
    here: WorkingSurface,
    other: WorkingSurface,
    sides: tuple[SurfaceSamples, SurfaceSamples],
    motion: Similarity,
) -> _Registered:
    own = sides[0].to_unit(here.mesh.vertices)
    moved = motion.apply(own)
    on_other = closest_points(sides[1], moved)
    gaps = np.linalg.norm(moved - on_other, axis=1)
    return _Registered(
        points=own,
        moved=moved,
        gaps=gaps,
        coincide=gaps <= NEAR,
        nearest=np.asarray(cKDTree(sides[1].to_unit(other.mesh.vertices)).query(on_other)[1]),
        length=sides[0].unit / motion.scale,
    )


def _inverse(motion: Similarity) -> Similarity:
    scale = 1.0 / motion.scale
    return Similarity(scale, motion.rotation.T, -scale * motion.shift @ motion.rotation)


def _scale(first: WorkingSurface, second: WorkingSurface, ahead: _Seen, behind: _Seen) -> float:
    """Return the root of the ratio of the areas that have a partner; of the whole areas where none has."""
    areas = [
        side.unit**2 * np.stack([own, own * seen.partnered]).sum(axis=1)
        for side, seen in ((first, ahead), (second, behind))
        for own in (vertex_areas(side.mesh.vertices, side.mesh.faces),)
    ]
    wholes, parts = np.stack(areas, axis=1)
    one, other = parts if parts.min() > 0.0 else wholes
    return float(np.sqrt(other / one))


def _of_given(seen: _Seen, here: WorkingSurface, other: WorkingSurface, scale: float) -> DenseCorrespondence:
    """Return the correspondence brought from the working surfaces to the given meshes."""
    whole = here.nearest
    return DenseCorrespondence(
        vertices=other.given[seen.there][whole].astype(np.int32),
        confidence=np.where(seen.partnered, seen.confidence, 0.0)[whole].astype(np.float32),
        stretch=stretch(here.mesh, other.mesh, seen.there)[whole].astype(np.float32),
        displacement=None if seen.displacement is None else seen.displacement[whole].astype(np.float32),
        partnered=seen.partnered[whole],
        scale=scale,
        simplified=here.simplified or other.simplified,
    )
