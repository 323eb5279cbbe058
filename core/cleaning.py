"""Cleaning: coinciding vertices are merged; faces that span nothing and negligible parts are dropped."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.errors import DegenerateMeshError
from core.mesh import Floats, Ints, Mesh
from core.ordering import canonical_order

MERGE_TOLERANCE = 1e-7
"""Vertices whose coordinates agree after rounding to this part of the bounding box's diagonal are one:
coarser than the rounding of float32 files, far finer than any detail."""

COVERED_AREA = 0.999
"""Parts are kept, largest first, until this part of the area is covered, and with the last all of its size:
dust around a scan goes, and the many equal parts of an assembly stay."""

EQUAL_AREA = 1e-6
"""Areas that differ by less than this part are equal."""

FARTHEST, SMALLEST = 1e30, 1e-30
"""Limits of a coordinate and of the bounding box's diagonal: products of four lengths are still numbers, and
positions fit into single precision."""


@dataclass(frozen=True, eq=False)
class Cleaned:
    """A mesh without defects of bookkeeping, and what was mended.

    Attributes
    ----------
    mesh : Mesh
        The cleaned mesh.
    labels : int64, shape (n,)
        The connected component of each vertex, 0 .. components - 1.
    components : int
        Connected components kept.
    merged_vertices, dropped_faces : int
        How many of the file's went.
    """

    mesh: Mesh
    labels: Ints
    components: int
    merged_vertices: int
    dropped_faces: int


def vertex_areas(vertices: Floats, faces: Ints) -> Floats:
    """A third of the area of the faces about each vertex, shape (n,)."""
    third = np.repeat(face_areas(vertices, faces) / 3.0, 3)
    return np.bincount(faces.ravel(), weights=third, minlength=len(vertices)).astype(np.float64)


def face_areas(vertices: Floats, faces: Ints) -> Floats:
    """Area of each face, shape (f,)."""
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


def merge_vertices(vertices: Floats) -> tuple[Ints, Ints]:
    """Vertices that coincide.

    Returns
    -------
    first : int64, shape (u,)
        One original index a distinct point.
    group : int64, shape (n,)
        The distinct point of each original vertex.

    Raises
    ------
    DegenerateMeshError
        All are one point, or a coordinate is past `FARTHEST`.
    """
    if float(np.abs(vertices).max()) > FARTHEST:
        raise DegenerateMeshError(f"vertices lie too far apart to measure: a coordinate is over {FARTHEST:g}")
    low = vertices.min(axis=0)
    diagonal = float(np.linalg.norm(vertices.max(axis=0) - low))
    if diagonal < SMALLEST:
        raise DegenerateMeshError("all vertices are one point")
    step = diagonal * MERGE_TOLERANCE
    keys = np.rint((vertices - low) / step).astype(np.int64)
    order = np.lexsort((np.arange(len(keys)), keys[:, 2], keys[:, 1], keys[:, 0]))
    ordered = keys[order]
    new = np.ones(len(order), dtype=bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    group = np.empty(len(order), dtype=np.int64)
    group[order] = np.cumsum(new) - 1
    return order[new], group


def _distinct_faces(faces: Ints) -> NDArray[np.bool_]:
    """True for faces with three different corners, the first of each set of faces on the same corners."""
    corners = np.sort(faces, axis=1)
    proper = (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2])
    order = np.lexsort((np.arange(len(corners)), corners[:, 2], corners[:, 1], corners[:, 0]))
    ordered = corners[order]
    again = np.zeros(len(order), dtype=bool)
    again[1:] = (ordered[1:] == ordered[:-1]).all(axis=1)
    proper[order[again]] = False
    return np.asarray(proper)


def component_labels(count: int, faces: Ints) -> tuple[int, Ints]:
    """Connected components of the vertices through the faces' edges: their number, and each vertex's own."""
    rows = np.concatenate([faces[:, 0], faces[:, 1]])
    columns = np.concatenate([faces[:, 1], faces[:, 2]])
    links = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(count, count))
    number, labels = connected_components(links.tocsr(), directed=False)
    return int(number), labels.astype(np.int64)


def _ordered(vertices: Floats, faces: Ints) -> Mesh:
    """The mesh with its vertices in their canonical order, and its faces in that of their corners."""
    areas = face_areas(vertices, faces)
    order = canonical_order(vertices, faces, areas @ vertices[faces].mean(axis=1) / areas.sum())
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    faces = place[faces]
    turns = (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3
    faces = np.take_along_axis(faces, turns, axis=1)
    return Mesh(vertices[order], faces[np.lexsort(faces.T[::-1])])


def clean(mesh: Mesh) -> Cleaned:
    """The mesh without duplicate vertices, degenerate or repeated faces, loose vertices and negligible parts.

    Vertices and faces come in an order that is the shape's own, not the file's: see `core.ordering`.
    Slivers of zero area stay while they join other faces: they carry no weight but keep the surface
    connected.

    Raises
    ------
    DegenerateMeshError
        Nothing has an area, or it is too large to measure.
    """
    first, group = merge_vertices(mesh.vertices)
    vertices = mesh.vertices[first]
    faces = group[mesh.faces]
    faces = faces[_distinct_faces(faces)]
    if len(faces) == 0:
        raise DegenerateMeshError("every face is a point or a line")
    areas = face_areas(vertices, faces)
    total = float(areas.sum())
    extent = float(np.ptp(vertices, axis=0).max())
    if total <= 1e-12 * extent * extent:
        raise DegenerateMeshError("the faces have no area")
    _, labels = component_labels(len(vertices), faces)
    by_component = np.bincount(labels[faces[:, 0]], weights=areas)
    order = np.argsort(-by_component, kind="stable")
    before = np.cumsum(by_component[order]) - by_component[order]
    last = by_component[order[before < COVERED_AREA * total][-1]]
    kept = by_component >= (1.0 - EQUAL_AREA) * last
    faces = faces[kept[labels[faces[:, 0]]]]
    used = np.unique(faces)
    renumber = np.full(len(vertices), -1, dtype=np.int64)
    renumber[used] = np.arange(len(used))
    cleaned = _ordered(vertices[used], renumber[faces])
    components, labels = component_labels(len(used), cleaned.faces)
    return Cleaned(
        mesh=cleaned,
        labels=labels,
        components=components,
        merged_vertices=len(mesh.vertices) - len(first),
        dropped_faces=len(mesh.faces) - len(faces),
    )
