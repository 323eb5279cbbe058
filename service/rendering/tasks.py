"""Tasks of workers that render meshes: meshes in, GLB files and pictures out.

A GLB is for viewers: it has small upright meshes with vertex colours.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import KDTree

from core.arrays import Floats
from core.embedding import DenseCorrespondence
from core.io import FORMATS
from core.mesh.cleaning import merge_vertices
from core.mesh.mesh import Mesh
from core.mesh.simplification import decimate
from core.numerics.guarding import guarded
from core.registration.probed_surface import probed_surface
from core.registration.similarity import Similarity
from core.registration.surface_distances import surface_distances
from service.rendering.colours import (
    Paint,
    colours_of_points,
    correspondence_colours,
    interpolate_colours,
    opaque,
    scale_colours,
    stretch_colours,
)
from service.rendering.thumbnail import draw_painted, frame, upright

MEDIA_TYPE = FORMATS["glb"].media_type

Ways = tuple[DenseCorrespondence, DenseCorrespondence]
"""The dense correspondence from the first of two meshes to the second, and back."""

SPACING = 2.4
"""Distance of the centres of neighbouring meshes, each of which extends from -1 to 1."""

_BYTE, _FLOAT, _UNSIGNED_INT = 5121, 5126, 5125


@dataclass(frozen=True, eq=False)
class ShownMesh:
    """A mesh, with the name of its shape and the format of its file, which determines the upward axis."""

    name: str
    format: str
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class GlbPart(ShownMesh):
    """One mesh of a GLB file, with `facts`, additional `extras` of its node.

    `colours`, uint8 of shape (n, 4) or (0, 4), are those of the vertices (red, green, blue, opacity), if any;
    `frame` has the middle and half the size of what is scaled to the common size, None for those of the mesh.
    """

    facts: dict[str, Any] = field(default_factory=dict)
    colours: NDArray[np.uint8] = field(default_factory=lambda: np.empty((0, 4), np.uint8))
    frame: tuple[Floats, float] | None = None


def write_glb(parts: list[GlbPart]) -> bytes:
    """Return a GLB of meshes side by side, each scaled to the same size, with y up.

    Positions are 32-bit floats in [-1, 1]. The matrix of a node places its mesh. Its `extras` have `middle`
    and `half`: a point p of the original file is stored as (p - middle) / half.
    """
    binary: list[bytes] = []
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    nodes: list[dict[str, Any]] = []
    meshes: list[dict[str, Any]] = []

    def add(array: NDArray[Any], component: int, kind: str, **more: Any) -> int:  # noqa: ANN401
        start = sum(map(len, binary))
        binary.append(array.tobytes())
        views.append({"buffer": 0, "byteOffset": start, "byteLength": array.nbytes})
        accessor = {"bufferView": len(views) - 1, "componentType": component, "type": kind}
        accessors.append({**accessor, "count": array.size if kind == "SCALAR" else len(array), **more})
        return len(accessors) - 1

    for number, part in enumerate(parts):
        vertices, faces = part.mesh.vertices, part.mesh.faces
        middle, half = part.frame or frame(vertices)
        points = ((vertices - middle) / half).astype("<f4")
        bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        attributes = {"POSITION": add(points, _FLOAT, "VEC3", **bounds)}
        if len(part.colours):
            attributes["COLOR_0"] = add(part.colours, _BYTE, "VEC4", normalized=True)
        indices = add(faces.astype("<u4").ravel(), _UNSIGNED_INT, "SCALAR")
        matrix = np.eye(4)
        matrix[:3, :3] = upright(part.format)
        matrix[0, 3] = SPACING * (number - 0.5 * (len(parts) - 1))
        meshes.append({"primitives": [{"attributes": attributes, "indices": indices}]})
        nodes.append(
            {
                "name": part.name,
                "mesh": number,
                "matrix": matrix.ravel(order="F").tolist(),
                "extras": {**part.facts, "middle": middle.tolist(), "half": half},
            }
        )
    tree = {
        "asset": {"version": "2.0", "generator": "Isoshape"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": meshes,
        "buffers": [{"byteLength": sum(map(len, binary))}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(tree, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    chunks = _chunk(b"JSON", text) + _chunk(b"BIN\0", b"".join(binary))
    return b"glTF" + _number(2) + _number(12 + len(chunks)) + chunks


def _chunk(kind: bytes, data: bytes) -> bytes:
    return _number(len(data)) + kind + data


def _number(value: int) -> bytes:
    return value.to_bytes(4, "little")


FACES = 20_000
"""Faces of a preview, enough for a picture that fills a screen."""


def preview(mesh: Mesh, format: str, faces: int) -> bytes:
    """Return a mesh as a GLB of at most about `faces` faces."""
    return write_glb([_part(ShownMesh("shape", format, mesh), faces)])


def coloured(pair: Sequence[ShownMesh], points: Sequence[Floats], faces: int) -> bytes:
    """Return two meshes as one GLB, coloured so that corresponding points have the same colour.

    `points` has the positions of p corresponding points on each mesh, shape (p, 3).
    """
    colours = colours_of_points(points[0], upright(pair[0].format))
    parts = []
    for shown, ends in zip(pair, points, strict=True):
        part = _part(shown, faces)
        parts.append(replace(part, colours=interpolate_colours(ends, colours, part.mesh.vertices)))
    return write_glb(parts)


def painted(
    pair: Sequence[ShownMesh], ways: Ways, paint: Paint, faces: int, size: int | None = None
) -> bytes:
    """Return two meshes painted by their dense correspondence both ways: as one GLB, or as a PNG with a size.

    With "difference" the extras of each node have the `quantity` "stretch" and the share of vertices
    `without_partner`. The PNG has both side by side on a transparent ground, `2 size` by `size` pixels.
    """
    return _drawn(_painted_parts(pair, ways, faces, paint), size)


def painted_distances(
    pair: Sequence[ShownMesh], placing: Similarity, registered: bool, faces: int, size: int | None = None
) -> bytes:
    """Return two meshes in the frame of the first, each painted by its distance from the other, as `painted`.

    `placing` maps the second mesh onto the first; `registered` tells whether it is that of a copy or variant.
    The extras of each node have the `quantity` "distance", `registered`, the `size` of the second mesh over
    that of the first, the `largest` distance that sampling does not explain, and the `maximum` of the scale,
    both in units of the first mesh and at its size.
    """
    return _drawn(_distance_parts(pair, placing, registered, faces), size)


def _drawn(parts: list[GlbPart], size: int | None) -> bytes:
    if size is None:
        return write_glb(parts)
    picture = Image.new("RGBA", (2 * size, size))
    for number, part in enumerate(parts):
        colours = part.colours[:, :3] / 255.0
        drawn = draw_painted(part.mesh, part.format, size, part.mesh.vertices, colours)
        picture.paste(Image.open(BytesIO(drawn)).convert("RGBA"), (number * size, 0))
    file = BytesIO()
    picture.save(file, "PNG")
    return file.getvalue()


def _painted_parts(pair: Sequence[ShownMesh], ways: Ways, faces: int, paint: Paint) -> list[GlbPart]:
    """Return both meshes, simplified for display, with their colours."""
    facts: list[dict[str, object]] = [{}, {}]
    if paint == "difference":
        colours = [stretch_colours(way) for way in ways]
        without = [float(1.0 - way.partnered.mean()) for way in ways]
        facts = [{"quantity": "stretch", "without_partner": share} for share in without]
    else:
        colours = [*correspondence_colours(pair[0].mesh.vertices, upright(pair[0].format), ways[1])]
    parts = []
    for shown, painted_colours, more in zip(pair, colours, facts, strict=True):
        part, vertices = _part(shown, faces), shown.mesh.vertices
        # A simplified mesh has the colours of the nearest vertices.
        simplified = part.mesh is not shown.mesh
        nearest = KDTree(vertices).query(part.mesh.vertices)[1] if simplified else slice(None)
        parts.append(replace(part, colours=opaque(painted_colours[nearest]), facts={**part.facts, **more}))
    return parts


def _distance_parts(
    pair: Sequence[ShownMesh], placing: Similarity, registered: bool, faces: int
) -> list[GlbPart]:
    """Return both meshes, simplified for display and refined where they differ, with their colours."""
    parts = [_part(shown, faces) for shown in pair]
    with guarded():
        surfaces = probed_surface(pair[0].mesh), probed_surface(pair[1].mesh)
        both = surface_distances((parts[0].mesh, parts[1].mesh), surfaces, placing.inverse)
    scales = 1.0, placing.scale
    maximum = max(scale * one.largest for scale, one in zip(scales, both, strict=True))
    meshes = both[0].mesh, _placed(both[1].mesh, placing)
    common = frame(pair[0].mesh.vertices)
    painted_parts = []
    for part, mesh, one, scale in zip(parts, meshes, both, scales, strict=True):
        colours = opaque(scale_colours(one.deviating * scale * one.distances / (maximum or 1.0)))
        facts = {"quantity": "distance", "registered": registered, "largest": scale * one.largest}
        facts |= {"maximum": maximum, "size": 1.0 / placing.scale, **part.facts}
        painted_parts.append(GlbPart(part.name, pair[0].format, mesh, facts, colours, common))
    return painted_parts


def _placed(mesh: Mesh, placing: Similarity) -> Mesh:
    """Return a mesh after a transform, its faces outward also after a reflection."""
    faces = mesh.faces if np.linalg.det(placing.rotation) > 0.0 else mesh.faces[:, ::-1]
    return Mesh(placing.apply(mesh.vertices), faces)


def _part(shown: ShownMesh, faces: int) -> GlbPart:
    """Return a mesh for display, simplified if it has more than `faces` faces."""
    mesh = shown.mesh
    if len(mesh.faces) > faces:
        # Decimation would separate faces without common vertices, as in STL.
        first, group = merge_vertices(mesh.vertices)
        mesh = decimate(Mesh(mesh.vertices[first], group[mesh.faces]), faces / len(mesh.faces), seed=0)
    return GlbPart(shown.name, shown.format, mesh, {"faces": len(shown.mesh.faces)})
