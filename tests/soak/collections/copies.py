"""Changed copies of a mesh in what each format allows, each with the triangles that it means.

A writer takes a mesh and random numbers, and moves, turns, scales and reorders the mesh first. Here are the
writers of `core.io` and of trimesh; `polygon_copies` and `scene_copies` have small ones of the tests.
"""

import io
import itertools
import zipfile
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from core.arrays import Floats
from core.io import write_mesh
from core.mesh.mesh import Mesh, face_normals
from tests.core.shapes import as_trimesh, rotation

METRE = 1_000.0
GLTF = ("glb", "gltf", "zip")
# Triangles of one plane that are merged at most, and the largest 1 - cosine between their normals.
MOST, _COPLANAR = 8, 1e-9


class Copy(NamedTuple):
    """A file, the ending of its name, the triangles that it means, shape (f, 3, 3), and its unit in mm.

    `misread` are the triangles that trimesh takes from it, where these are others.
    """

    data: bytes
    ending: str
    triangles: Floats
    unit: float = 1.0
    misread: Floats | None = None


Writer = Callable[[Mesh, np.random.Generator], Copy]


def changed(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Return a mesh turned, scaled, moved by up to its size, with its vertices and faces in another order."""
    size = float(np.ptp(mesh.vertices, axis=0).max())
    turned = mesh.vertices @ rotation(rng.integers(1_000)).T
    moved = 10.0 ** rng.uniform(-1, 1) * (turned + size * rng.uniform(-1, 1, 3))
    order = rng.permutation(len(moved))
    numbers = np.empty_like(order)
    numbers[order] = np.arange(len(order))
    faces = numbers[mesh.faces[rng.permutation(len(mesh.faces))]]
    return Mesh(moved[order], np.roll(faces, rng.integers(3), axis=1))


def merged(mesh: Mesh, most: int = MOST) -> list[list[int]]:
    """Return polygons that cover the mesh once: neighbours in one plane become one, of different corners."""
    corners = mesh.vertices[mesh.faces]
    normals, faces = face_normals(corners), mesh.faces.tolist()
    beside: dict[tuple[int, int], int] = {}
    for number, (a, b, c) in enumerate(faces):
        for edge in ((a, b), (b, c), (c, a)):
            # An edge of two faces in one direction joins none.
            beside[edge] = -1 if edge in beside else number
    free = normals.any(axis=1) & (np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1) > 0)
    polygons = []
    taken = np.zeros(len(faces), dtype=bool)
    for number in range(len(faces)):
        if taken[number]:
            continue
        taken[number] = True
        polygon, side = list(faces[number]), 0
        while free[number] and side < len(polygon) < most + 2:
            start, end = polygon[side], polygon[(side + 1) % len(polygon)]
            other = beside.get((end, start), -1)
            side += 1
            if (
                other < 0
                or taken[other]
                or not free[other]
                or 1 - normals[number] @ normals[other] > _COPLANAR
            ):
                continue
            apex = next(corner for corner in faces[other] if corner not in (start, end))
            if apex not in polygon:
                taken[other] = True
                polygon.insert(side, apex)
                side -= 1
        polygons.append(polygon)
    return polygons


def fans(mesh: Mesh, polygons: list[list[int]]) -> Floats:
    """Return the triangles between the first corner of each polygon and its sides, shape (f, 3, 3)."""
    return mesh.vertices[[[row[0], *side] for row in polygons for side in itertools.pairwise(row[1:])]]


def whole(mesh: Mesh) -> Floats:
    return mesh.vertices[mesh.faces]


def plain(mesh: Mesh, rng: np.random.Generator, write: Callable[[Mesh], bytes], ending: str) -> Copy:
    """Return a copy by a writer of meshes."""
    mesh = changed(mesh, rng)
    return Copy(write(mesh), ending, whole(mesh), METRE if ending in GLTF else 1.0)


def by_core(format: str) -> Writer:
    """Return the writer of `core.io`; its numbers are millimetres."""
    unit = METRE if format == "glb" else 1.0
    return lambda mesh, rng: plain(
        mesh, rng, lambda moved: write_mesh(Mesh(unit * moved.vertices, moved.faces), format), format
    )


def by_trimesh(format: str, ending: str = "", **options: Any) -> Writer:
    """Return the writer of trimesh; its numbers are the file's."""

    def write(mesh: Mesh) -> bytes:
        data = as_trimesh(mesh).export(file_type=format, **options)
        if isinstance(data, dict):
            return zipped(data)
        return data.encode() if isinstance(data, str) else data

    return lambda mesh, rng: plain(mesh, rng, write, ending or format)


def zipped(files: dict[str, bytes | str]) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return file.getvalue()


def split(mesh: Mesh, rng: np.random.Generator, most: int) -> Iterator[Mesh]:
    """Yield pieces of a mesh, each with vertices of its own."""
    for faces in np.array_split(mesh.faces, min(len(mesh.faces), rng.integers(1, most + 1))):
        used, corners = np.unique(faces, return_inverse=True)
        yield Mesh(mesh.vertices[used], corners.reshape(-1, 3))
