"""The triangles of a glTF mesh."""

from collections.abc import Iterator

import numpy as np

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError
from core.io.gltf_accessor import count_elements, read_indices, read_positions
from core.io.gltf_document import Document, Entry, entries, whole

_TRIANGLES, _STRIP, _FAN = 4, 5, 6


def primitives(mesh: Entry) -> Iterator[tuple[Entry, int]]:
    """Yield the primitives of triangles with their mode; points and lines are left out."""
    for primitive in entries(mesh, "primitives"):
        mode = whole(primitive, "mode", _TRIANGLES)
        if mode in {_TRIANGLES, _STRIP, _FAN}:
            yield primitive, mode


def _source(primitive: Entry) -> tuple[object, object]:
    """Return the accessor indices of the indices (None if absent) and of the positions."""
    attributes = primitive.get("attributes")
    if not isinstance(attributes, dict) or "POSITION" not in attributes:
        raise MalformedMeshError("a primitive of the GLB has no positions")
    return primitive.get("indices"), attributes["POSITION"]


def count_triangles(document: Document, primitive: Entry, mode: int) -> int:
    """Return the number of triangles of a primitive without reading them."""
    indices, positions = _source(primitive)
    count = count_elements(document, positions if indices is None else indices)
    if mode == _TRIANGLES and count % 3:
        raise MalformedMeshError(
            f"a primitive of the GLB has {count} corners, which do not make whole triangles"
        )
    return count // 3 if mode == _TRIANGLES else max(count - 2, 0)


def read_triangles(document: Document, primitive: Entry, mode: int) -> tuple[Floats, Ints]:
    """Read a primitive; the number of its triangles is already checked.

    Returns
    -------
    positions : float64, shape (n, 3)
        The positions that triangles use; primitives often share an array and use a part of it each.
    faces : int64, shape (f, 3)
    """
    indices, positions = _source(primitive)
    count = count_elements(document, positions)
    corners = np.arange(count) if indices is None else read_indices(document, indices)
    if len(corners) and corners.max() >= count:
        raise MalformedMeshError(
            f"a face of the GLB refers to vertex {int(corners.max())}, counted from 0, "
            f"but there are {count} vertices"
        )
    if mode == _TRIANGLES:
        faces = corners.reshape(-1, 3)
    elif mode == _FAN:
        faces = np.column_stack([np.broadcast_to(corners[:1], len(corners[2:])), corners[1:-1], corners[2:]])
    else:
        faces = np.column_stack([corners[:-2], corners[1:-1], corners[2:]])
        # Every second triangle of a strip has the opposite orientation.
        faces[1::2] = faces[1::2, ::-1]
    used, faces = _used(count, faces)
    return read_positions(document, positions, used), faces


def _used(count: int, faces: Ints) -> tuple[Ints, Ints]:
    """Return the vertices, of `count`, that faces use, in ascending order, and the faces in their numbers."""
    if count > faces.size:
        # Many primitives may share one array: a pass over it for each would take unbounded time.
        used, places = np.unique(faces, return_inverse=True)
        return used, places.reshape(-1, 3)
    mask = np.zeros(count, dtype=bool)
    mask[faces] = True
    return np.flatnonzero(mask), (np.cumsum(mask) - 1)[faces]
