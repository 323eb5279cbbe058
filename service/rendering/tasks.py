"""Pictures, made in the workers: meshes in, bytes out."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.mesh.cleaning import merge_vertices
from core.mesh.mesh import Mesh
from core.mesh.simplification import decimate
from service.rendering.colours import colours_of_points, spread
from service.rendering.glb import Part, write_glb
from service.rendering.viewpoint import upright

FACES = 20_000
"""Enough for a picture as large as a screen."""


@dataclass(frozen=True, eq=False)
class Side:
    """One of two shapes to colour.

    Attributes
    ----------
    name, format : str
        What it is called, and the format of its file.
    mesh : Mesh
    points : float64, shape (p, 3)
        Its ends of the p pairs, in the file's frame.
    """

    name: str
    format: str
    mesh: Mesh
    points: NDArray[np.float64]


def preview(mesh: Mesh, format: str, faces: int) -> bytes:
    """A mesh as a GLB of at most about `faces` faces."""
    return write_glb([_part("shape", mesh, format, faces)])


def coloured(first: Side, second: Side, faces: int) -> bytes:
    """Both meshes as one GLB, painted so that points that correspond have one colour."""
    colours = colours_of_points(first.points, upright(first.format))
    parts = []
    for side in (first, second):
        part = _part(side.name, side.mesh, side.format, faces)
        parts.append(replace(part, colours=spread(side.points, colours, part.vertices)))
    return write_glb(parts)


def _part(name: str, mesh: Mesh, format: str, faces: int) -> Part:
    """A mesh as it is shown: simplified where it has more faces."""
    shown = mesh
    if len(mesh.faces) > faces:
        # Faces that share no vertices, as in STL, would come apart.
        first, group = merge_vertices(mesh.vertices)
        shown = decimate(Mesh(mesh.vertices[first], group[mesh.faces]), faces / len(mesh.faces), seed=0)
    return Part(name, format, shown.vertices, shown.faces, {"faces": len(mesh.faces)})
