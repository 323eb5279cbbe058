"""The intrinsic Delaunay triangulation of a surface or of its tufted cover, by edge flips.

A. Bobenko, B. Springborn, "A discrete Laplace-Beltrami operator for simplicial surfaces", 2007. Flips change
the triangulation and not the surface; after them the cotangent weights are not negative.
"""

import math

import numpy as np

from core.arrays import Floats, Ints
from core.mesh.edges import HalfEdges, edge_lengths
from core.mesh.mesh import Mesh
from core.numerics.compilation import compiled

MOLLIFIED = 1e-5
"""Least excess of two sides of a triangle over the third, in mean edge lengths; if a triangle has less, all
edges are lengthened by the same amount (Sharp and Crane 2020, section 4.5)."""

MOST_FLIPS = 20
"""Largest number of flips for each half-edge. Real meshes need about one, but a fan of n thin triangles needs
a multiple of n^2. Any triangulation of the surface gives a positive semidefinite Laplacian."""


def tufted_cover(vertices: Floats, faces: Ints, sides: HalfEdges) -> tuple[Ints, Ints]:
    """Return the faces of the tufted cover, a closed, oriented surface from any triangles, and its gluing.

    Every face has a front and a back copy. Around each edge, the side of a face is glued to the side of the
    next face that it faces; at a boundary edge the front is glued to the back of the same face (N. Sharp,
    K. Crane, "A Laplacian for nonmanifold triangle meshes", 2020, section 4.1).

    The cover, shape (2 f, 3), has the faces, then the same with their corners in the opposite order; the
    gluing, shape (6 f,), has the half-edge that each half-edge is glued to, in the opposite direction.
    """
    count = len(faces)
    cover = np.concatenate([faces, faces[:, ::-1][:, [2, 0, 1]]])
    order = _around_edges(vertices, faces, sides)
    reverse = 3 * count + order // 3 * 3 + 2 - order % 3
    ascends = faces.ravel()[order] == sides.low
    # The copy that faces larger angles around the edge runs from its lower to its higher vertex.
    upper, lower = np.where(ascends, order, reverse), np.where(ascends, reverse, order)
    following = np.arange(1, len(order) + 1)
    following[sides.first + sides.face_counts - 1] = sides.first
    twin = np.empty(6 * count, dtype=np.int64)
    twin[upper], twin[lower[following]] = lower[following], upper
    return cover, twin


def _around_edges(vertices: Floats, faces: Ints, sides: HalfEdges) -> Ints:
    """Return the half-edges grouped by edge; those of one edge by the angle of their faces around it."""
    order = sides.order.copy()
    edge_of = np.repeat(np.arange(len(sides.first)), sides.face_counts)
    crowded = np.flatnonzero((sides.face_counts > 2)[edge_of])
    if not len(crowded):
        return order
    edge, low = edge_of[crowded], vertices[sides.low[crowded]]
    axis = vertices[sides.high[crowded]] - low
    length = np.linalg.norm(axis, axis=1)
    axis /= np.where(length > 0.0, length, 1.0)[:, None]
    across = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
    first = np.cross(axis, across)
    outwards = vertices[faces[:, [2, 0, 1]].ravel()[order[crowded]]] - low
    angles = np.arctan2(
        np.einsum("ij,ij->i", outwards, np.cross(axis, first)), np.einsum("ij,ij->i", outwards, first)
    )
    order[crowded] = order[crowded[np.lexsort((angles, edge))]]
    return order


def twins(faces: Ints, sides: HalfEdges) -> Ints | None:
    """Return the opposite of each half-edge, shape (3 f,); None unless the surface is closed and oriented.

    In a closed, oriented surface every edge has two faces, which traverse it in opposite directions.
    """
    if len(sides.order) != 2 * len(sides.first) or not (sides.face_counts == 2).all():
        return None
    start = faces.ravel()[sides.order].reshape(-1, 2)
    if (start[:, 0] == start[:, 1]).any():
        return None
    result = np.empty(len(sides.order), dtype=np.int64)
    pairs = sides.order.reshape(-1, 2)
    result[pairs[:, 0]], result[pairs[:, 1]] = pairs[:, 1], pairs[:, 0]
    return result


def mollified_lengths(lengths: Floats) -> Floats:
    """Return the side lengths, shape (f, 3), after all have grown by the gap of the worst triangle."""
    a, b, c = lengths.T
    needed = MOLLIFIED * float(lengths.mean()) + (2.0 * np.maximum(np.maximum(a, b), c) - (a + b + c)).max()
    return np.asarray(lengths + max(0.0, needed))


@compiled
def _cotangent(a: float, b: float, c: float) -> float:
    """Return half the cotangent of the angle opposite side a of a triangle, -1e300 without area."""
    half = 0.5 * (a + b + c)
    square = half * (half - a) * (half - b) * (half - c)
    if not square > 0.0:
        return -1e300
    return (b * b + c * c - a * a) / (8.0 * math.sqrt(square))


@compiled
def _flip_all(tails: Ints, lengths: Floats, twin: Ints, most: int) -> int:
    """Flip edges until no edge has a negative weight, or `most` times; return the number of flips."""
    sides = len(twin)
    queue = np.empty(sides + 1, dtype=np.int64)
    waits = np.zeros(sides, dtype=np.bool_)
    size = 0
    for h in range(sides):
        if h < twin[h]:
            queue[size] = h
            waits[h] = True
            size += 1
    first, last, flips = 0, size, 0
    while first != last and flips < most:
        h = queue[first]
        first = first + 1 if first < sides else 0
        waits[h] = False
        g = twin[h]
        f, k = h // 3 * 3, g // 3 * 3
        if f == k:
            continue
        h1, h2 = f + (h + 1) % 3, f + (h + 2) % 3
        g1, g2 = k + (g + 1) % 3, k + (g + 2) % 3
        length = lengths[h]
        weight = _cotangent(length, lengths[h1], lengths[h2]) + _cotangent(length, lengths[g1], lengths[g2])
        if weight >= -1e-6 or weight < -1e299:
            continue
        # The two opposite corners in a plane; the edge runs along x from the tail of h.
        along_h = (length**2 + lengths[h2] ** 2 - lengths[h1] ** 2) / (2.0 * length)
        along_g = (length**2 + lengths[g1] ** 2 - lengths[g2] ** 2) / (2.0 * length)
        up_h = np.sqrt(max(0.0, lengths[h2] ** 2 - along_h**2))
        up_g = np.sqrt(max(0.0, lengths[g1] ** 2 - along_g**2))
        across = np.sqrt((along_h - along_g) ** 2 + (up_h + up_g) ** 2)
        tail = tails[h1], tails[h2], tails[g1], tails[g2]
        size_of = lengths[h1], lengths[h2], lengths[g1], lengths[g2]
        other = twin[h1], twin[h2], twin[g1], twin[g2]
        # The new position of each side; the new edge joins the two opposite corners.
        to = g2, h1, h2, g1
        tails[h], tails[g] = tail[3], tail[1]
        lengths[h] = across
        lengths[g] = across
        for i in range(4):
            tails[to[i]] = tail[i]
            lengths[to[i]] = size_of[i]
            mate = other[i]
            if mate == h1:
                mate = to[0]
            elif mate == h2:
                mate = to[1]
            elif mate == g1:
                mate = to[2]
            elif mate == g2:
                mate = to[3]
            twin[to[i]] = mate
            twin[mate] = to[i]
        for i in range(4):
            side = to[i]
            if not waits[side] and not waits[twin[side]]:
                queue[last] = side
                last = last + 1 if last < sides else 0
                waits[side] = True
        flips += 1
    return flips


@compiled
def _weights(tails: Ints, lengths: Floats, weights: Floats, areas: Floats) -> None:
    """Fill the weights of the half-edges and add to the areas of the vertices; a face of area 0 adds 0."""
    for f in range(0, len(tails), 3):
        a, b, c = lengths[f], lengths[f + 1], lengths[f + 2]
        half = 0.5 * (a + b + c)
        square = half * (half - a) * (half - b) * (half - c)
        if not square > 0.0:
            weights[f : f + 3] = 0.0
            continue
        area = np.sqrt(square)
        weights[f] = (b * b + c * c - a * a) / (8.0 * area)
        weights[f + 1] = (c * c + a * a - b * b) / (8.0 * area)
        weights[f + 2] = (a * a + b * b - c * c) / (8.0 * area)
        for i in range(3):
            areas[tails[f + i]] += area / 3.0


def intrinsic_delaunay(mesh: Mesh) -> tuple[Ints, Ints, Floats, Floats]:
    """Return the cotangent weights of the intrinsic Delaunay triangulation of a surface.

    A surface that is not closed and oriented is covered twice (`tufted_cover`), and its weights
    and areas are half of the cover's. After `MOST_FLIPS` the weights are those of the triangulation reached.

    The results are the vertices at both ends of each edge, shapes (e,), where e is 3 f / 2, or 3 f of a
    cover; half the sum of the cotangents of the two angles opposite it, shape (e,); and a third of the area
    of the triangles at each vertex, shape (n,).
    """
    vertices, faces = mesh.vertices, mesh.faces
    twin, sheets = twins(faces, mesh.half_edges), 1
    if twin is None:
        (faces, twin), sheets = tufted_cover(vertices, faces, mesh.half_edges), 2
    tails = faces.ravel().copy()
    edges = np.stack([tails, faces[:, [1, 2, 0]].ravel()], axis=1)
    lengths = mollified_lengths(edge_lengths(vertices, edges).reshape(-1, 3)).ravel()
    _flip_all(tails, lengths, twin, MOST_FLIPS * len(twin))
    weights, areas = np.empty(len(tails)), np.zeros(len(vertices))
    _weights(tails, lengths, weights, areas)
    one = np.flatnonzero(np.arange(len(twin)) < twin)
    other = twin[one]
    return tails[one], tails[other], (weights[one] + weights[other]) / sheets, areas / sheets
