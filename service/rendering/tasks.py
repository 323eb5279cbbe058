"""Tasks of workers that render meshes: meshes in, GLB files out."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.mesh.cleaning import merge_vertices
from core.mesh.mesh import Mesh
from core.mesh.simplification import decimate
from service.rendering.colours import colours_of_points, interpolate_colours
from service.rendering.glb import GlbPart, write_glb
from service.rendering.viewpoint import upright

FACES = 20_000
"""Faces of a preview, enough for a picture that fills a screen."""


@dataclass(frozen=True, eq=False)
class ComparedMesh:
    """One of two meshes whose corresponding points get the same colour.

    Attributes
    ----------
    name, format : str
        Name of the shape and format of its file.
    mesh : Mesh
    points : float64, shape (p, 3)
        Positions of the p corresponding points in the coordinates of the file.
    """

    name: str
    format: str
    mesh: Mesh
    points: NDArray[np.float64]


def preview(mesh: Mesh, format: str, faces: int) -> bytes:
    """A mesh as a GLB of at most about `faces` faces."""
    return write_glb([_part("shape", mesh, format, faces)])


def coloured(first: ComparedMesh, second: ComparedMesh, faces: int) -> bytes:
    """Both meshes as one GLB, coloured so that corresponding points have the same colour."""
    colours = colours_of_points(first.points, upright(first.format))
    parts = []
    for side in (first, second):
        part = _part(side.name, side.mesh, side.format, faces)
        parts.append(replace(part, colours=interpolate_colours(side.points, colours, part.vertices)))
    return write_glb(parts)


def _part(name: str, mesh: Mesh, format: str, faces: int) -> GlbPart:
    """A mesh for display, simplified if it has more than `faces` faces."""
    shown = mesh
    if len(mesh.faces) > faces:
        # Decimation would separate faces without common vertices, as in STL.
        first, group = merge_vertices(mesh.vertices)
        shown = decimate(Mesh(mesh.vertices[first], group[mesh.faces]), faces / len(mesh.faces), seed=0)
    return GlbPart(name, format, shown.vertices, shown.faces, {"faces": len(mesh.faces)})
