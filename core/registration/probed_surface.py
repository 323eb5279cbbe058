"""A surface to be registered and judged: samples, the smooth surface, and probes of its deviations."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh, face_normals
from core.registration.curved_surface import CurvedSurface, curved_surface
from core.sampling.surface_samples import SurfaceSamples, evenly_spread_shares, samples_of_cleaned

VERTICES, ALONG, MIDDLES, SPREAD = 1000, 800, 500, 1000
"""Most vertices among the probes, points along sharp edges, middles of sharp and of bent edges, and points
spread by area."""

OF_REGION = 8
"""Middles of edges in each smooth region, however small it is: the wall of a hole has many."""

FIT = 3
"""Stride through the probes, along edges and over the area, in the fit of a transform."""


@dataclass(frozen=True, eq=False)
class ProbedSurface:
    """A surface at unit area, with its centroid at the origin.

    Attributes
    ----------
    samples : SurfaceSamples
    curved : CurvedSurface
    corners : int64, shape (v,)
        For each vertex, the corner at it of the triangle with the largest chord error.
    shares : float64, shape (n, 3)
        Barycentric coordinates of the probes: vertices, points of sharp edges, points spread by area.
    faces : int64, shape (n,)
        Their faces.
    points : float64, shape (n, 3)
        The probes on the smooth surface.
    normals : float64, shape (n, 3)
        Its unit normals there.
    errors : float64, shape (n,)
        The chord error at each probe.
    fit : int64, shape (k,)
        The probes that take part in the fit of a transform.
    rims : float64, shape (r, 3)
        Points spread along the sharp edges; empty for a surface without any.
    """

    samples: SurfaceSamples
    curved: CurvedSurface
    corners: Ints
    shares: Floats
    faces: Ints
    points: Floats
    normals: Floats
    errors: Floats
    fit: Ints
    rims: Floats

    @cached_property
    def faceted(self) -> "ProbedSurface":
        """The surface whose triangles approximate nothing: the probes lie on them, without chord errors."""
        curved = self.curved.faceted
        points, normals, errors = curved.at(self.shares, self.faces)
        return replace(self, curved=curved, points=points, normals=normals, errors=errors)

    @cached_property
    def rim_tree(self) -> cKDTree:
        """Search tree of `rims`."""
        return cKDTree(self.rims)


def probed_surface(mesh: Mesh) -> ProbedSurface:
    """Return the samples and the probes of a mesh; raise DegenerateMeshError if it has no area."""
    surface = clean(mesh).mesh
    samples = samples_of_cleaned(surface)
    curved = curved_surface(surface, samples.centre, samples.unit)
    corners = np.empty(len(surface.vertices), dtype=np.int64)
    # As the points of an edge, a vertex belongs to the triangle with the largest chord error.
    rising = np.argsort(np.repeat(curved.chord, 3), kind="stable")
    corners[curved.corner_vertices[rising]] = rising
    some = corners[:: max(1, -(-len(corners) // VERTICES))]
    along, places = _along(curved)
    middles = _some(curved.sharp, curved)
    folds = _some(curved.folds, curved)
    sides = np.concatenate([along, middles, folds])
    places = np.concatenate([places, np.full(len(middles) + len(folds), 0.5)])
    on_sides = np.zeros((len(sides), 3))
    rows = np.arange(len(sides))
    on_sides[rows, sides % 3] = 1.0 - places
    on_sides[rows, (sides + 1) % 3] = places
    areas = np.linalg.norm(face_normals(curved.corners, unit=False), axis=1)
    spread, spread_faces = evenly_spread_shares(areas, SPREAD)
    shares = np.concatenate([np.eye(3)[some % 3], on_sides, spread])
    faces = np.concatenate([some // 3, sides // 3, spread_faces])
    points, normals, _ = curved.at(shares, faces)
    start = len(some)
    on_rims = np.arange(start, start + len(along))
    after = np.arange(start + len(sides), len(faces))
    return ProbedSurface(
        samples=samples,
        curved=curved,
        corners=corners,
        shares=shares,
        faces=faces,
        points=points,
        normals=normals,
        errors=curved.errors_of(shares, faces),
        fit=np.concatenate([np.arange(0, start, FIT), on_rims[::FIT], after[::FIT]]),
        rims=points[on_rims],
    )


def _some(sides: Ints, curved: CurvedSurface) -> Ints:
    """Return at most `MIDDLES` half-edges, evenly chosen, and in addition some of each smooth region."""
    if len(sides) <= MIDDLES:
        return sides
    regions = curved.regions[sides // 3]
    order = np.argsort(regions, kind="stable")
    _, first, counts = np.unique(regions[order], return_index=True, return_counts=True)
    rank = np.arange(len(sides)) - np.repeat(first, counts)
    each = np.repeat(np.maximum(counts // OF_REGION, 1), counts)
    chosen = (rank % each == 0) & (rank // each < OF_REGION)
    some = order[chosen][:MIDDLES] if chosen.sum() > MIDDLES else order[chosen]
    return np.asarray(sides[np.union1d(some, np.arange(0, len(sides), -(-len(sides) // MIDDLES)))])


def _along(curved: CurvedSurface) -> tuple[Ints, Floats]:
    """Return half-edges of points spread evenly along the sharp edges, and the place of each on it."""
    ends = curved.corners[curved.sharp // 3]
    rows = np.arange(len(ends))
    lengths = np.linalg.norm(ends[rows, (curved.sharp + 1) % 3] - ends[rows, curved.sharp % 3], axis=1)
    total = np.cumsum(lengths)
    if not len(total) or total[-1] <= 0.0:
        return np.empty(0, dtype=np.int64), np.empty(0)
    wanted = (np.arange(ALONG) + 0.5) / ALONG * total[-1]
    places = np.minimum(np.searchsorted(total, wanted), len(total) - 1)
    return curved.sharp[places], (wanted - (total - lengths)[places]) / lengths[places]
