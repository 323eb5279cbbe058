"""The smooth surface that a triangle mesh approximates, and the error of the approximation.

Vertices of a tessellation lie on the surface; the triangles between them are off by the chord error. Normals
at the corners give the surface between the vertices to the second order (T. Boubekeur and M. Alexa, "Phong
tessellation", SIGGRAPH Asia 2008, Eq. 4; half of the displacement is that of a circular arc).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.mesh.box_tree import TriangleTree, triangle_tree
from core.mesh.edges import component_labels
from core.mesh.mesh import Mesh, face_normals

ON_EDGE = 1e-9
"""Barycentric coordinate of a corner below which a point lies on the opposite edge."""

CREASE = float(np.cos(np.radians(46.0)))
"""Least cosine between the normals of two triangles of one smooth surface: a circle has eight chords."""

COPLANAR = float(np.cos(np.radians(0.1)))
"""Least cosine between the normals of two triangles of one plane facet."""

TINY = float(np.finfo(np.float64).tiny)

POWER = 2.0
"""Power of the area of a facet in its weight: a plane gives the normal at its border to a fillet."""

PLANE = 4.0
"""Area of a plane over that of the facets of a fillet that meets it, at least."""

SPACING, QUALITY = 0.5, 0.5
"""Error of an even mesh at edges and tips that its vertices do not follow, over the length of its edges and
the tangent of half the angle by which a triangle bends; and the least quality of its triangles, which is 1
for an equilateral one."""

STEEPEST = 0.5 * np.pi
"""Largest angle by which a triangle of such a mesh bends: that of an edge of a cube."""


GAP, GAPS = 4, 0.05
"""Most edges of the boundary of a gap, where a facet or two are missing; and the most boundary edges of gaps
over all edges. More is a polygon soup."""


@dataclass(frozen=True, eq=False)
class CurvedSurface:
    """A triangle mesh as an approximation of a smooth surface with sharp edges.

    Attributes
    ----------
    corners : float64, shape (f, 3, 3)
        Corners of the triangles.
    normals : float64, shape (f, 3, 3)
        Unit normals of the smooth surface at the corners.
    flat : float64, shape (f, 3)
        Unit normals of the triangles.
    chord : float64, shape (f,)
        Estimated largest distance of each triangle from the smooth surface: the sum of the sagittas across
        its smooth edges, as a sphere bends in two directions.
    spread : float64, shape (f, 3)
        Largest chord error around each corner: of its triangles, and the mean of their smooth regions.
    sagittas : float64, shape (f, 3)
        The same without the heights of edges that an even mesh does not follow: these lie between vertices.
    own : float64, shape (f,)
        Chord error of each triangle itself, or the mean of its smooth region: 0 for planes.
    planar : bool, shape (f,)
        Whether a triangle is part of a flat facet that bends smoothly to no other: not of a plane that a
        fillet meets.
    regions : int64, shape (f,)
        The smooth region of each triangle: regions meet at sharp edges.
    twins : int64, shape (3 f,)
        For half-edge 3 f + i, from corner i of face f to the next, the half-edge of the other face, or -1.
    sharp : int64, shape (s,)
        One half-edge of each sharp edge and of each boundary edge: that of the face with the larger `chord`.
    folds : int64, shape (e,)
        One half-edge of each edge at which the surface bends smoothly.
    at_gap : bool, shape (3 f,)
        Whether a half-edge bounds a gap: the surface beyond it is unknown.
    corner_vertices : int64, shape (3 f,)
        The vertex at each corner.
    handles : int or None
        Number of handles (through holes), if the mesh is closed.
    """

    corners: Floats
    normals: Floats
    flat: Floats
    chord: Floats
    spread: Floats
    sagittas: Floats
    own: Floats
    planar: NDArray[np.bool_]
    regions: Ints
    twins: Ints
    sharp: Ints
    folds: Ints
    at_gap: NDArray[np.bool_]
    corner_vertices: Ints
    handles: int | None

    @cached_property
    def volume(self) -> float:
        """The volume that the surface encloses, >= 0; it means little if the mesh is not closed."""
        return abs(float(np.linalg.det(self.corners).sum())) / 6.0

    @cached_property
    def moments(self) -> Floats:
        """The principal second moments of the triangles about the origin, over their area, shape (3,)."""
        areas = np.linalg.norm(face_normals(self.corners, unit=False), axis=1)
        # The integral of x x^T over a triangle is A / 12 times the sum over the corners and their sum.
        points = np.concatenate([self.corners, self.corners.sum(axis=1, keepdims=True)], axis=1)
        moments = np.einsum("f,fcx,fcy->xy", areas / (12.0 * areas.sum()), points, points)
        return np.linalg.eigvalsh(moments)

    @cached_property
    def at_rim(self) -> NDArray[np.bool_]:
        """Whether each half-edge is one of a sharp edge or of the boundary, shape (3 f,)."""
        at_rim = np.zeros(len(self.twins), dtype=bool)
        at_rim[self.sharp] = True
        at_rim[self.twins[self.sharp]] |= self.twins[self.sharp] >= 0
        return at_rim

    @cached_property
    def faceted(self) -> "CurvedSurface":
        """The triangles themselves as the surface, without chord errors."""
        flat = np.repeat(self.flat[:, None], 3, axis=1)
        none, nowhere = np.zeros(len(self.corners)), np.zeros((len(self.corners), 3))
        surface = replace(self, normals=flat, chord=none, spread=nowhere, sagittas=nowhere, own=none)
        vars(surface)["tree"] = self.tree
        return surface

    @cached_property
    def tree(self) -> TriangleTree:
        """The search tree of the triangles."""
        return triangle_tree(self.corners)

    def at(self, shares: Floats, faces: Ints) -> tuple[Floats, Floats, Floats]:
        """Return points of the smooth surface above points of triangles, with normals and chord errors.

        Parameters
        ----------
        shares : float64, shape (n, 3)
            Barycentric coordinates.
        faces : int64, shape (n,)

        Returns
        -------
        points, normals : float64, shape (n, 3)
        errors : float64, shape (n,)
            Interpolated between the largest errors around the corners.
        """
        corners, normals = self.corners[faces], self.normals[faces]
        points = np.einsum("nc,ncx->nx", shares, corners)
        heights = np.einsum("ncx,ncx->nc", points[:, None] - corners, normals)
        bulge = -0.5 * np.einsum("nc,nc,ncx->nx", shares, heights, normals)
        length = np.linalg.norm(bulge, axis=1)
        bulge *= np.minimum(1.0, self.chord[faces] / np.maximum(length, TINY))[:, None]
        smooth = np.einsum("nc,ncx->nx", shares, normals)
        smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), TINY)
        return points + bulge, smooth, np.einsum("nc,nc->n", shares, self.spread[faces])

    def errors_of(self, shares: Floats, faces: Ints) -> Floats:
        """Return the chord errors of points of the triangles themselves, shape (n,): less at the vertices."""
        at_vertex = shares.max(axis=1) >= 1.0 - ON_EDGE
        errors = np.where(at_vertex[:, None], self.sagittas[faces], self.spread[faces])
        return np.asarray(np.einsum("nc,nc->n", shares, errors))

    def sagged(self, shares: Floats, faces: Ints) -> Floats:
        """Return the chord errors of points themselves, shape (n,): none at a vertex or on a plane."""
        return np.asarray(1.5 * (1.0 - np.einsum("nc,nc->n", shares, shares)) * self.own[faces])

    def closest(self, points: Floats, guess: Ints | None = None) -> tuple[Floats, Ints]:
        """Return the closest points of the triangles, as shares and faces.

        The arc of a rim belongs to the curved surface on its one side, not to the plane on its other side: of
        the two triangles at an edge, the one with the larger chord error counts.
        """
        shares, faces = self.tree.closest(points, guess)
        least = shares.argmin(axis=1)
        starts = 3 * faces + (least + 1) % 3
        twins = self.twins[starts]
        others = twins // 3
        rows = np.flatnonzero(
            (shares[np.arange(len(shares)), least] <= ON_EDGE)
            & (twins >= 0)
            & (self.chord[others] > self.chord[faces])
        )
        ours, theirs = starts[rows], twins[rows]
        ends = shares[rows, ours % 3], shares[rows, (ours + 1) % 3]
        same = self.corner_vertices[ours] == self.corner_vertices[theirs]
        faces[rows], shares[rows] = others[rows], 0.0
        shares[rows, theirs % 3] = np.where(same, ends[0], ends[1])
        shares[rows, (theirs + 1) % 3] = np.where(same, ends[1], ends[0])
        return shares, faces


def curved_surface(mesh: Mesh, centre: Floats, unit: float) -> CurvedSurface:
    """Return the surface of a cleaned mesh, moved by `-centre` and divided by `unit`."""
    vertices = (mesh.vertices - centre) / unit
    corners = vertices[mesh.faces]
    flat = face_normals(corners)
    # Angles across the edges of two faces; twins in one direction have opposite normals.
    sides = mesh.half_edges
    paired = sides.face_counts == 2
    half_edge, twin = sides.order[sides.first[paired]], sides.order[sides.first[paired] + 1]
    faces, others = half_edge // 3, twin // 3
    cosines = np.einsum("ex,ex->e", flat[faces], flat[others])
    opposed = mesh.faces[faces, half_edge % 3] != mesh.faces[others, twin % 3]
    cosines = np.where(opposed, cosines, -cosines)
    # Edges are flat, bent (of a curved surface) or sharp.
    folded, gentle = cosines < COPLANAR, cosines >= CREASE
    facets = _regions(len(corners), faces[~folded], others[~folded])
    rounded = _rounded(facets, facets[faces[gentle & folded]], facets[others[gentle & folded]])
    bent = gentle & folded & (rounded[faces] | rounded[others])
    smooth = bent | ~folded
    # Sagittas of arcs across the bent edges, summed over each triangle and averaged over its region.
    ends = sides.edges[paired]
    lengths = np.linalg.norm(vertices[ends[:, 1]] - vertices[ends[:, 0]], axis=1)
    areas = 0.5 * np.linalg.norm(face_normals(corners, unit=False), axis=1)
    widths = 2.0 * np.minimum(areas[faces], areas[others]) / np.maximum(lengths, TINY)
    turns = np.where(folded, np.arccos(np.clip(cosines, -1.0, 1.0)), 0.0)
    angles = np.where(bent, turns, 0.0)
    both = np.concatenate([faces, others])
    chord = _sums(both, np.tile(0.5 * widths * np.tan(0.25 * angles), 2), len(corners))
    regions = _regions(len(corners), faces[smooth], others[smooth])
    # A facet that is much larger than all to which it bends is a plane that a fillet meets.
    facet_areas = _sums(facets, areas)
    largest = np.zeros(len(facet_areas))
    for ours, theirs in ((faces[bent], others[bent]), (others[bent], faces[bent])):
        np.maximum.at(largest, facets[ours], facet_areas[facets[theirs]])
    plane = (facet_areas > PLANE * largest)[facets]
    # Vertices of a fillet may tilt such a plane, but not one that only sharp edges bound.
    planar = (_sums(facets, chord) == 0.0)[facets]
    round_areas = areas * (chord > 0.0)
    means = _sums(regions, round_areas * chord) / np.maximum(_sums(regions, round_areas), TINY)
    sagittas = np.maximum(chord, means[regions])
    # Even meshes do not follow edges and tips, at which they bend smoothly or sharply.
    loose = _scattered(
        corners,
        areas,
        np.concatenate([faces[bent], others[bent]]),
        np.concatenate([faces[folded], others[folded]]),
    )
    bends = np.minimum(_sums(both, np.tile(turns, 2), len(corners)), STEEPEST)
    heights = SPACING * edge_lengths(corners).mean(axis=1) * np.tan(0.5 * bends)
    errors = np.where(loose, np.maximum(sagittas, heights), sagittas)
    twins = np.full(3 * len(corners), -1)
    twins[half_edge], twins[twin] = twin, half_edge
    unpaired = sides.order[sides.first[~paired]]
    on_curved = np.where(chord[others] > chord[faces], twin, half_edge)
    return CurvedSurface(
        corners=corners,
        normals=corner_normals(
            mesh.faces, corners, flat, facet_areas[facets], half_edge[smooth], twin[smooth]
        ),
        flat=flat,
        chord=chord,
        spread=_around(mesh.faces, errors),
        sagittas=_around(mesh.faces, sagittas),
        own=np.where(plane, 0.0, errors),
        planar=planar,
        regions=regions,
        twins=twins,
        sharp=np.concatenate([on_curved[~smooth], unpaired]),
        folds=half_edge[bent],
        at_gap=_at_gap(mesh.faces, unpaired, len(sides.first)),
        corner_vertices=mesh.faces.ravel(),
        handles=_handles(mesh, len(sides.first)) if paired.all() else None,
    )


def _at_gap(faces: Ints, unpaired: Ints, edges: int) -> NDArray[np.bool_]:
    """Return whether each half-edge bounds a gap; `unpaired` are the half-edges of the boundary."""
    at_gap = np.zeros(faces.size, dtype=bool)
    rows, starts = np.divmod(unpaired, 3)
    ends = np.stack([faces[rows, starts], faces[rows, (starts + 1) % 3]], axis=1)
    _, loops = component_labels(int(faces.max()) + 1, ends)
    small = np.bincount(loops[ends[:, 0]], minlength=1)[loops[ends[:, 0]]] <= GAP
    if small.sum() <= GAPS * edges:
        at_gap[unpaired[small]] = True
    return at_gap


def _sums(groups: Ints, values: Floats, count: int = 0) -> Floats:
    """Return the sums of the values of each group."""
    return np.bincount(groups, weights=values, minlength=count).astype(np.float64)


def _around(faces: Ints, errors: Floats) -> Floats:
    """Return the largest error of the triangles around each corner, shape (f, 3)."""
    around = np.zeros(int(faces.max()) + 1)
    np.maximum.at(around, faces.ravel(), np.repeat(errors, 3))
    return np.asarray(around[faces])


def _handles(mesh: Mesh, edges: int) -> int:
    """Return the number of handles of a closed mesh, of all components together, by Euler's formula."""
    components, _ = component_labels(len(mesh.vertices), mesh.faces)
    return components - (len(mesh.vertices) - edges + len(mesh.faces)) // 2


def _scattered(corners: Floats, areas: Floats, bent: Ints, folded: Ints) -> NDArray[np.bool_]:
    """Return whether each triangle is one of an even mesh, whose vertices follow no edges of the surface.

    Such a triangle is well shaped, bends smoothly at two edges or more, and is coplanar with no neighbour.
    `bent` and `folded` have the triangle at each side of each edge that bends smoothly, and that bends at
    all.
    """
    quality = 4.0 * np.sqrt(3.0) * areas / np.maximum((edge_lengths(corners) ** 2).sum(axis=1), TINY)
    count = len(corners)
    many = (np.bincount(bent, minlength=count) >= 2) & (np.bincount(folded, minlength=count) == 3)
    return np.asarray((quality > QUALITY) & many)


def _regions(count: int, faces: Ints, others: Ints) -> Ints:
    """Return the connected components of triangles, by pairs of neighbours, shape (f,)."""
    return component_labels(count, np.stack([faces, others], axis=1))[1]


def _rounded(facets: Ints, facet: Ints, neighbour: Ints) -> NDArray[np.bool_]:
    """Return whether the facet of each triangle bends smoothly to two facets or more, shape (f,).

    Two large planes may meet at a small angle; the facets of a curved surface come in rows. `facet` and
    `neighbour` are the facets on both sides of each edge at which the surface bends smoothly.
    """
    count = int(facets.max()) + 1
    least, most = np.full(count, count), np.full(count, -1)
    for ours, theirs in ((facet, neighbour), (neighbour, facet)):
        np.minimum.at(least, ours, theirs)
        np.maximum.at(most, ours, theirs)
    return np.asarray((least < most)[facets])


def edge_lengths(corners: Floats) -> Floats:
    """Return the lengths of the edges of triangles, shape (f, 3)."""
    return np.asarray(np.linalg.norm(corners[:, [1, 2, 0]] - corners, axis=2))


def corner_normals(
    faces: Ints, corners: Floats, flat: Floats, facets: Floats, half_edge: Ints, twin: Ints
) -> Floats:
    """Return means of the normals around each corner, up to sharp edges, weighted by angles, shape (f, 3, 3).

    `half_edge` and `twin` are the two half-edges of each smooth edge.
    """
    # Half-edge 3 f + i starts at corner i of its face and ends at corner i + 1.
    next_edge, next_twin = half_edge - half_edge % 3 + (half_edge + 1) % 3, twin - twin % 3 + (twin + 1) % 3
    corner_of = faces.ravel()
    crossed = corner_of[half_edge] == corner_of[twin]
    joined = np.where(crossed, twin, next_twin), np.where(crossed, next_twin, twin)
    pairs = np.stack([np.concatenate([half_edge, next_edge]), np.concatenate(joined)], axis=1)
    count, group = component_labels(3 * len(faces), pairs)
    sides = corners[:, [1, 2, 0]] - corners
    lengths = np.maximum(edge_lengths(corners), TINY)
    products = np.einsum("fcx,fcx->fc", sides, sides[:, [2, 0, 1]])
    cosines = -products / (lengths * lengths[:, [2, 0, 1]])
    weights = np.arccos(np.clip(cosines, -1.0, 1.0)) * (facets**POWER)[:, None]
    weighted = np.repeat(flat, 3, axis=0) * weights.reshape(-1, 1)
    sums: Floats = np.stack([np.bincount(group, each, count) for each in weighted.T], axis=1)
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), TINY)
    return np.asarray(sums[group].reshape(-1, 3, 3))
