"""Cleaning: merges coincident vertices, drops degenerate faces and negligible components."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.errors import DegenerateMeshError
from core.mesh.edges import component_labels, starts_of
from core.mesh.mesh import Mesh
from core.mesh.ordering import canonical_order
from core.numerics.compilation import compiled_for_reading
from core.numerics.radix_sort import lexical_order

MERGE_TOLERANCE = 1e-7
"""Vertices are merged if their coordinates agree after rounding to this fraction of the bounding box's
diagonal: coarser than the rounding of float32 files, far finer than any detail."""

COVERED_AREA = 0.999
"""Components are kept, largest first, until they have this share of the area, and with the last one all of
its size: debris around a scan is dropped, the many equal components of an assembly stay."""

EQUAL_AREA = 1e-6
"""Relative difference below which areas are equal."""

FARTHEST, SMALLEST = 1e30, 1e-30
"""Largest coordinate, and smallest diagonal of the bounding box: products of four lengths stay finite, and
positions fit into single precision."""


@dataclass(frozen=True, eq=False)
class Cleaned:
    """A cleaned mesh, the connected component of each vertex, shape (n,), and counts of the repairs.

    Labels are 0 .. components - 1, of the components that were kept.
    """

    mesh: Mesh
    labels: Ints
    components: int
    merged_vertices: int
    dropped_faces: int


def vertex_areas(vertices: Floats, faces: Ints) -> Floats:
    """Return a third of the area of the faces at each vertex, shape (n,)."""
    third = np.repeat(face_areas(vertices, faces) / 3.0, 3)
    return np.bincount(faces.ravel(), weights=third, minlength=len(vertices)).astype(np.float64)


def component_areas(mesh: Mesh) -> Floats:
    """Return the area of the connected component of each vertex, shape (n,)."""
    count, part = component_labels(len(mesh.vertices), mesh.faces)
    areas = face_areas(mesh.vertices, mesh.faces)
    return np.asarray(np.bincount(part[mesh.faces[:, 0]], weights=areas, minlength=count)[part])


@compiled_for_reading
def face_areas(vertices: Floats, faces: Ints) -> Floats:
    """Return the area of each face, shape (f,)."""
    areas = np.empty(len(faces))
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        areas[f] = 0.5 * np.sqrt(x * x + y * y + z * z)
    return areas


@compiled_for_reading
def centroid(vertices: Floats, faces: Ints, areas: Floats) -> Floats:
    """Return the centroid of the surface, shape (3,), weighted by the areas of the faces, of sum > 0."""
    total = 0.0
    centre = np.zeros(3)
    for f in range(len(faces)):
        total += areas[f]
        for axis in range(3):
            corners = 0.0
            for i in range(3):
                corners += vertices[faces[f, i], axis]
            centre[axis] += areas[f] * corners / 3.0
    return centre / total


def merge_vertices(vertices: Floats) -> tuple[Ints, Ints]:
    """Group vertices that coincide, up to `MERGE_TOLERANCE`.

    Return one original index for each distinct point, shape (u,), and the distinct point of each original
    vertex, shape (n,). Raise DegenerateMeshError if all coincide, or a coordinate exceeds `FARTHEST`.
    """
    low, high = bounds(vertices)
    if max(-low.min(), high.max()) > FARTHEST:
        raise DegenerateMeshError(f"vertices lie too far apart to measure: a coordinate is over {FARTHEST:g}")
    diagonal = float(np.linalg.norm(high - low))
    if diagonal < SMALLEST:
        raise DegenerateMeshError("all vertices are one point")
    steps = np.rint((vertices - low) / (diagonal * MERGE_TOLERANCE)).astype(np.int64)
    columns = np.ascontiguousarray(steps.T)
    order = lexical_order(*columns)
    new = starts_of(*columns[:, order])
    group = np.empty(len(order), dtype=np.int64)
    group[order] = np.cumsum(new) - 1
    return order[new], group


def bounds(vertices: Floats) -> tuple[Floats, Floats]:
    """Return the least and the largest coordinates, shapes (3,), of n >= 1 vertices, shape (n, 3)."""
    low, high = (np.array([extreme(axis) for axis in vertices.T]) for extreme in (np.min, np.max))
    return low, high


def distinct_faces(faces: Ints) -> NDArray[np.bool_]:
    """Return whether each face has three corners and is the first on these corners, shape (f,)."""
    # Columns take a tenth of the time that rows of three take.
    a, b, c = faces.T
    low = np.minimum(np.minimum(a, b), c)
    high = np.maximum(np.maximum(a, b), c)
    middle = a + b + c - low - high
    proper = (low != middle) & (middle != high)
    order = lexical_order(low, middle, high)
    again = ~starts_of(low[order], middle[order], high[order])
    proper[order[again]] = False
    return np.asarray(proper)


def _ordered(vertices: Floats, faces: Ints) -> Mesh:
    """Return the mesh with its vertices in canonical order and its faces in lexical order.

    Faces are turned so that the smallest index comes first; orientation is kept.
    """
    areas = face_areas(vertices, faces)
    order = canonical_order(vertices, faces, centroid(vertices, faces, areas))
    numbers = np.empty(len(order), dtype=np.int64)
    numbers[order] = np.arange(len(order))
    faces = numbers[faces]
    turns = (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3
    faces = np.take_along_axis(faces, turns, axis=1)
    return Mesh(vertices[order], faces[lexical_order(*faces.T)])


def clean(mesh: Mesh) -> Cleaned:
    """Remove duplicate vertices, degenerate or repeated faces, unused vertices and negligible components.

    Vertices and faces are in canonical order (`core.mesh.ordering`), which does not depend on the file's
    order. Slivers of zero area stay where they join other faces: they have no weight but connect the surface.
    Raise DegenerateMeshError if the mesh has no area, or a coordinate exceeds `FARTHEST`.
    """
    first, group = merge_vertices(mesh.vertices)
    vertices = mesh.vertices[first]
    faces = group[mesh.faces]
    faces = faces[distinct_faces(faces)]
    if len(faces) == 0:
        raise DegenerateMeshError("every face is a point or a line")
    # A surface has area, beside the extent of its vertices.
    areas = face_areas(vertices, faces)
    total = float(areas.sum())
    low, high = bounds(vertices)
    extent = float((high - low).max())
    if total <= 1e-12 * extent * extent:
        raise DegenerateMeshError("the faces have no area")
    # The components that cover the area, and those as large as the last of them.
    _, labels = component_labels(len(vertices), faces)
    by_component = np.bincount(labels[faces[:, 0]], weights=areas)
    order = np.argsort(-by_component, kind="stable")
    before = np.cumsum(by_component[order]) - by_component[order]
    last = by_component[order[before < COVERED_AREA * total][-1]]
    kept = by_component >= (1.0 - EQUAL_AREA) * last
    faces = faces[kept[labels[faces[:, 0]]]]
    # The vertices that their faces use, in canonical order.
    mask = np.zeros(len(vertices), dtype=bool)
    mask[faces.ravel()] = True
    used = np.flatnonzero(mask)
    renumber = np.cumsum(mask) - 1
    cleaned = _ordered(vertices[used], renumber[faces])
    components, labels = component_labels(len(used), cleaned.faces)
    return Cleaned(
        mesh=cleaned,
        labels=labels,
        components=components,
        merged_vertices=len(mesh.vertices) - len(first),
        dropped_faces=len(mesh.faces) - len(faces),
    )
