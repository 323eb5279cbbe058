"""Preparation of a mesh before it is sampled: clean, closed, in its normal frame, bounded in size, smooth.

Around a hole, or where a limb is cut off, geodesics detour and the Laplacian's domain ends; a closed surface
has the distances of the complete shape. A boundary loop is closed by a fan around its centre if the disc that
it can bound is small beside the surface. The boundary of a sheet or of a single triangle stays open: a planar
surface is no larger than the disc of its boundary loop.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.mesh.cleaning import Cleaned, clean, component_areas
from core.mesh.edges import boundary_half_edges, boundary_loops, edge_lengths
from core.mesh.mesh import Mesh, face_normals
from core.mesh.normal_frame import NormalFrame, normal_frame
from core.mesh.simplification import CONNECTED, simplify
from core.mesh.subdivision import refine
from core.numerics.compilation import compiled_for_reading
from core.parameters import MeshParameters

SHRINK, GROW = 0.5, -0.53
"""Taubin's lambda and mu: the second step undoes the shrinkage of low frequencies by the first."""

MOST_IN_TREE = 200_000
"""Largest number of vertices in a search tree. Where vertices coincide, the tree takes any one of them, and
the embeddings of smaller meshes keep its choice."""


class PreparedSurface(NamedTuple):
    """A mesh that is ready to be sampled: the cleaned mesh, its frame, and whether it was rough.

    The surface is clean, with its holes filled, in its normal frame; simplified, smoothed and refined as the
    parameters ask.
    """

    surface: Mesh
    cleaned: Cleaned
    frame: NormalFrame
    smoothed: bool


def prepared_surface(mesh: Mesh, wanted: MeshParameters, least_vertices: int) -> PreparedSurface:
    """Prepare a mesh; raise DegenerateMeshError if it has no area.

    The later stages need so many vertices at least: a coarser mesh is refined.
    """
    cleaned = clean(mesh)
    surface = cleaned.mesh
    if wanted.fill_holes:
        surface = fill_holes(surface, wanted.fill_holes)
    frame = normal_frame(surface)
    normal = _simplified(Mesh(frame.apply(surface.vertices), surface.faces), wanted)
    fineness = _fineness(surface, normal, wanted, least_vertices)
    rough = _is_rough(normal, wanted, fineness)
    if rough:
        normal = taubin_smoothing(normal, wanted.smooth_rounds)
    return PreparedSurface(_refined(normal, fineness), cleaned, frame, rough)


def open_surface(cleaned: Cleaned, wanted: MeshParameters, least_vertices: int) -> Mesh:
    """Return a cleaned mesh, simplified and smoothed, in its normal frame, with open boundary loops.

    Parameters are those of `prepared_surface`.
    """
    frame = normal_frame(cleaned.mesh)
    normal = _simplified(Mesh(frame.apply(cleaned.mesh.vertices), cleaned.mesh.faces), wanted)
    rough = _is_rough(normal, wanted, _fineness(cleaned.mesh, normal, wanted, least_vertices))
    return taubin_smoothing(normal, wanted.smooth_rounds) if rough else normal


def _simplified(normal: Mesh, wanted: MeshParameters) -> Mesh:
    """Simplify a large mesh; the mesh is in its normal frame."""
    most = wanted.decimate_above
    if most and len(normal.faces) < CONNECTED * len(normal.vertices):
        most = wanted.decimate_pieces_above or most
    return simplify(normal, wanted.decimate_to) if most and len(normal.vertices) > most else normal


def _fineness(given: Mesh, normal: Mesh, wanted: MeshParameters, least_vertices: int) -> int:
    """Return the number of vertices of an even mesh that is as fine as the surface must be.

    A surface with more vertices may have long edges too. The result is 0 if the surface stays as it is.
    """
    needed = max(wanted.refine_vertices, least_vertices)
    if wanted.refine_simplified and len(normal.vertices) < len(given.vertices):
        return max(wanted.refine_simplified, needed)
    return needed if wanted.refine_vertices or len(normal.vertices) < needed else 0


def _is_rough(normal: Mesh, wanted: MeshParameters, fineness: int) -> bool:
    most = wanted.smooth_above
    if not most or roughness(normal) <= most:
        return False
    return not wanted.smooth_refined or roughness(_refined(normal, fineness)) > most


def _refined(normal: Mesh, fineness: int) -> Mesh:
    return refine(normal, fineness) if fineness else normal


def fill_holes(mesh: Mesh, most: float) -> Mesh:
    """Close holes: each boundary loop gets a centre vertex, and a face from each edge to it.

    A boundary loop is a simple closed chain of edges that have one face each. A loop of length l bounds a
    disc of area at most l^2 / 4 pi, and is closed if that is at most a share, `most` >= 0, of the area of its
    connected component. Coincident vertices are merged. The new vertices and faces are at the end.
    """
    edges = boundary_half_edges(mesh.faces, mesh.half_edges)
    loops = boundary_loops(edges, len(mesh.vertices))
    on = loops >= 0
    if not on.any():
        return mesh
    (start, end), loops = edges[on].T, loops[on]
    lengths = np.linalg.norm(mesh.vertices[start] - mesh.vertices[end], axis=1)
    whole = np.bincount(loops, weights=lengths)
    area = component_areas(mesh)[start[np.unique(loops, return_index=True)[1]]]
    closed = whole**2 <= 4.0 * np.pi * most * area
    if not closed.any():
        return mesh
    # Weighted by edge length: denser vertices on one side do not move the centre.
    between = lengths[:, None] * (mesh.vertices[start] + mesh.vertices[end]) / 2.0
    middles = np.stack([np.bincount(loops, weights=each) for each in between.T], axis=1) / whole[:, None]
    number = len(mesh.vertices) + np.cumsum(closed) - 1
    used = closed[loops]
    fans = np.stack([end[used], start[used], number[loops[used]]], axis=1)
    return Mesh(np.concatenate([mesh.vertices, middles[closed]]), np.concatenate([mesh.faces, fans]))


@compiled_for_reading
def neighbour_means(edges: Ints, values: Floats) -> Floats:
    """Return means of vertex values over the neighbours of each vertex, shape (n, 3); 0 without neighbours.

    The edges, shape (e, 2), are distinct.
    """
    counts = np.zeros(len(values))
    for edge in range(len(edges)):
        counts[edges[edge, 0]] += 1.0
        counts[edges[edge, 1]] += 1.0
    shares = 1.0 / np.maximum(counts, 1.0)
    means = np.zeros((len(values), 3))
    for edge in range(len(edges)):
        start, end = edges[edge, 0], edges[edge, 1]
        for axis in range(3):
            means[start, axis] += shares[start] * values[end, axis]
            means[end, axis] += shares[end] * values[start, axis]
    return means


def vertex_normals(mesh: Mesh) -> Floats:
    """Return area-weighted unit vertex normals, shape (n, 3); 0 where the normals of the faces cancel."""
    normals = face_normals(mesh.vertices[mesh.faces], unit=False)
    corners, weights = mesh.faces.ravel(), np.repeat(normals, 3, axis=0).T
    sums = np.stack([np.bincount(corners, each, len(mesh.vertices)) for each in weights], axis=1)
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1), 1e-300)[:, None])


def roughness(mesh: Mesh) -> float:
    """Return the median normal part of the squared umbrella Laplacian, in mean edge lengths; >= 0.

    The umbrella Laplacian is the mean of a vertex's neighbours minus the vertex. It is small on a smooth
    surface, and large on a crease along a line only. Clean scans and CAD parts are below 0.07; the same
    meshes simplified to a tenth, or to 250 vertices, below 0.2; independent noise of half an edge gives 0.3.
    """
    links = mesh.half_edges.edges
    once = neighbour_means(links, mesh.vertices) - mesh.vertices
    twice = neighbour_means(links, once) - once
    sides = np.stack([mesh.faces.ravel(), np.roll(mesh.faces, 1, axis=1).ravel()], axis=1)
    length = float(edge_lengths(mesh.vertices, sides).mean())
    return float(np.median(np.abs((twice * vertex_normals(mesh)).sum(axis=1)))) / length


def taubin_smoothing(mesh: Mesh, iterations: int) -> Mesh:
    """Remove noise at the scale of the edges, by pairs of steps that do not shrink the shape (Taubin 1995).

    Every vertex belongs to a face.
    """
    links = mesh.half_edges.edges
    points = mesh.vertices
    for _ in range(iterations):
        for step in (SHRINK, GROW):
            points = points + step * (neighbour_means(links, points) - points)
    return Mesh(points, mesh.faces)


def nearest_vertices(vertices: Floats, points: Floats) -> Ints:
    """Return the vertex nearest to each point, shape (p,).

    The tree of a million vertices takes twenty times as long to build as their distances to a hundred points.
    """
    if len(vertices) <= MOST_IN_TREE:
        return np.asarray(cKDTree(vertices).query(points)[1])
    return _first_nearest(vertices, points.T)


@compiled_for_reading
def _first_nearest(vertices: Floats, columns: Floats) -> Ints:
    """Return the first vertex of least distance from each point; points are columns, shape (3, p)."""
    least = np.full(columns.shape[1], np.inf)
    nearest = np.zeros(columns.shape[1], dtype=np.int64)
    for v in range(len(vertices)):
        x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        for p in range(columns.shape[1]):
            square = (columns[0, p] - x) ** 2 + (columns[1, p] - y) ** 2 + (columns[2, p] - z) ** 2
            if square < least[p]:
                least[p], nearest[p] = square, v
    return nearest
