"""Tasks of workers that render meshes: meshes in, GLB files and pictures out."""

from dataclasses import dataclass, replace
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import KDTree

from core.arrays import Floats
from core.embedding import DenseCorrespondence
from core.mesh.cleaning import merge_vertices
from core.mesh.mesh import Mesh
from core.mesh.simplification import decimate, diagonal
from service.rendering.colours import (
    Paint,
    colours_of_points,
    correspondence_colours,
    difference_colours,
    differences,
    interpolate_colours,
)
from service.rendering.glb import GlbPart, write_glb
from service.rendering.thumbnail import draw_painted, upright

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


@dataclass(frozen=True, eq=False)
class PaintedMesh:
    """One of two meshes that are painted vertex by vertex.

    Attributes
    ----------
    name, format : str
        Name of the shape and format of its file.
    mesh : Mesh
    way : DenseCorrespondence
        To the other mesh.
    """

    name: str
    format: str
    mesh: Mesh
    way: DenseCorrespondence


def preview(mesh: Mesh, format: str, faces: int) -> bytes:
    """Return a mesh as a GLB of at most about `faces` faces."""
    return write_glb([_part("shape", mesh, format, faces)])


def coloured(first: ComparedMesh, second: ComparedMesh, faces: int) -> bytes:
    """Return both meshes as one GLB, coloured so that corresponding points have the same colour."""
    colours = colours_of_points(first.points, upright(first.format))
    parts = []
    for side in (first, second):
        part = _part(side.name, side.mesh, side.format, faces)
        parts.append(replace(part, colours=interpolate_colours(side.points, colours, part.vertices)))
    return write_glb(parts)


def painted(first: PaintedMesh, second: PaintedMesh, faces: int, paint: Paint) -> bytes:
    """Return both meshes as one GLB, painted by their dense correspondence.

    With "difference" the extras of each node have the `quantity` that is shown, the `maximum` of the scale,
    in units of the mesh, and the share of vertices `without_partner`.
    """
    return write_glb(_painted_parts(first, second, faces, paint))


def painted_picture(first: PaintedMesh, second: PaintedMesh, faces: int, paint: Paint, size: int) -> bytes:
    """Return both meshes as one PNG, side by side on a transparent background, `2 size` by `size` pixels."""
    picture = Image.new("RGBA", (2 * size, size))
    for number, part in enumerate(_painted_parts(first, second, faces, paint)):
        mesh = Mesh(part.vertices, part.faces)
        drawn = draw_painted(mesh, part.format, size, part.vertices, part.colours[:, :3] / 255.0)
        picture.paste(Image.open(BytesIO(drawn)).convert("RGBA"), (number * size, 0))
    file = BytesIO()
    picture.save(file, "PNG")
    return file.getvalue()


def _painted_parts(first: PaintedMesh, second: PaintedMesh, faces: int, paint: Paint) -> list[GlbPart]:
    """Return both meshes, simplified for display, with their colours."""
    sides = first, second
    facts: list[dict[str, object]] = [{}, {}]
    if paint == "difference":
        ends = differences((first.way, second.way), (diagonal(first.mesh), diagonal(second.mesh)))
        colours = tuple(
            difference_colours(end, side.way.partnered) for end, side in zip(ends, sides, strict=True)
        )
        facts = [
            {
                "quantity": end.quantity,
                "maximum": end.maximum,
                "without_partner": float(1.0 - side.way.partnered.mean()),
            }
            for end, side in zip(ends, sides, strict=True)
        ]
    else:
        colours = correspondence_colours(first.mesh.vertices, upright(first.format), second.way)
    parts = []
    for side, painted_colours, more in zip(sides, colours, facts, strict=True):
        part = _part(side.name, side.mesh, side.format, faces)
        shown = painted_colours
        if part.vertices is not side.mesh.vertices:
            shown = _nearest(side.mesh, painted_colours, part.vertices)
        parts.append(replace(part, colours=_opaque(shown), facts={**part.facts, **more}))
    return parts


def _nearest(mesh: Mesh, colours: Floats, vertices: Floats) -> Floats:
    """Return the colours of the vertices of a mesh at the nearest ones of a simplified mesh."""
    return np.asarray(colours[KDTree(mesh.vertices).query(vertices)[1]])


def _opaque(colours: Floats) -> NDArray[np.uint8]:
    """Return red, green, blue and opacity 255, shape (n, 4)."""
    whole = np.hstack([colours, np.ones((len(colours), 1))])
    return np.asarray(np.rint(255.0 * whole), dtype=np.uint8)


def _part(name: str, mesh: Mesh, format: str, faces: int) -> GlbPart:
    """Return a mesh for display, simplified if it has more than `faces` faces."""
    shown = mesh
    if len(mesh.faces) > faces:
        # Decimation would separate faces without common vertices, as in STL.
        first, group = merge_vertices(mesh.vertices)
        shown = decimate(Mesh(mesh.vertices[first], group[mesh.faces]), faces / len(mesh.faces), seed=0)
    return GlbPart(name, format, shown.vertices, shown.faces, {"faces": len(mesh.faces)})
