"""Print plates made by code: several parts in one file."""

from collections.abc import Iterable, Sequence

import numpy as np

from core.mesh.mesh import Mesh
from tests.studies.copies import moved


def plate(parts: Iterable[Mesh], columns: int = 3) -> Mesh:
    """Return parts side by side in rows, each turned in its own way about the vertical axis.

    The pieces do not touch.
    """
    parts = list(parts)
    pitch = 1.2 * max(float(np.linalg.norm(np.ptp(part.vertices, axis=0))) for part in parts)
    turned = []
    for i, part in enumerate(parts):
        cos, sin = np.cos(0.7 * i), np.sin(0.7 * i)
        points = part.vertices @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        row, column = divmod(i, columns)
        turned.append(Mesh(points + np.array([pitch * column, pitch * row, 0.0]), part.faces))
    return joined(turned)


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Return meshes as one."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def mirror_image(mesh: Mesh) -> Mesh:
    """Return the mirror image of a mesh, moved."""
    return moved(mesh, 1, mirrored=True)
