"""Tasks of workers that render meshes: meshes in, GLB files and pictures out."""

from dataclasses import dataclass, replace
from io import BytesIO

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
    opaque,
)
from service.rendering.glb import GlbPart, write_glb
from service.rendering.thumbnail import draw_painted, upright

FACES = 20_000
"""Faces of a preview, enough for a picture that fills a screen."""


@dataclass(frozen=True, eq=False)
class ShownMesh:
    """A mesh, with the name of its shape and the format of its file."""

    name: str
    format: str
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class ComparedMesh(ShownMesh):
    """One of two meshes with p corresponding points, which have positions of shape (p, 3)."""

    points: Floats


@dataclass(frozen=True, eq=False)
class PaintedMesh(ShownMesh):
    """One of two meshes that are painted vertex by vertex, and its correspondence to the other mesh."""

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
    facts: list[dict[str, object]] = [{}, {}]
    if paint == "difference":
        ways = first.way, second.way
        ends = differences(ways, (diagonal(first.mesh), diagonal(second.mesh)))
        colours = (
            difference_colours(ends[0], first.way.partnered),
            difference_colours(ends[1], second.way.partnered),
        )
        facts = [
            {
                "quantity": end.quantity,
                "maximum": end.maximum,
                "without_partner": float(1.0 - way.partnered.mean()),
            }
            for end, way in zip(ends, ways, strict=True)
        ]
    else:
        colours = correspondence_colours(first.mesh.vertices, upright(first.format), second.way)
    parts = []
    for side, painted_colours, more in zip((first, second), colours, facts, strict=True):
        part = _part(side.name, side.mesh, side.format, faces)
        # A simplified mesh has the colours of the nearest vertices.
        simplified = part.vertices is not side.mesh.vertices
        shown = KDTree(side.mesh.vertices).query(part.vertices)[1] if simplified else slice(None)
        parts.append(replace(part, colours=opaque(painted_colours[shown]), facts={**part.facts, **more}))
    return parts


def _part(name: str, mesh: Mesh, format: str, faces: int) -> GlbPart:
    """Return a mesh for display, simplified if it has more than `faces` faces."""
    shown = mesh
    if len(mesh.faces) > faces:
        # Decimation would separate faces without common vertices, as in STL.
        first, group = merge_vertices(mesh.vertices)
        shown = decimate(Mesh(mesh.vertices[first], group[mesh.faces]), faces / len(mesh.faces), seed=0)
    return GlbPart(name, format, shown.vertices, shown.faces, {"faces": len(mesh.faces)})
