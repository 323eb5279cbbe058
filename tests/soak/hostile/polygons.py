"""Counts and indices: what STL, OBJ, OFF and PLY declare, and what their faces refer to."""

import struct

from tests.core.io.files import (
    CUBE,
    SQUARES,
    TRIANGLES,
    binary_ply,
    binary_stl,
    glb,
    lines,
    obj,
    off,
    ply,
    ply_header,
    stl,
)
from tests.soak.hostile.bodies import CUBE_CORNERS, TRIANGLE
from tests.soak.hostile.case import Hostile, malformed, refused, stored

MOST = 4_000_000_000
WIDE = ("list uint int vertex_indices",)


def cases() -> list[Hostile]:
    """All of them."""
    return [*_counts(), *_large_indices(), *_signed_indices(), *_no_faces(), *_container()]


def _counts() -> list[Hostile]:
    corners = TRIANGLE.astype("<f4").tobytes()
    triangle = struct.pack("<I3i", MOST, 0, 1, 2)
    return [
        *malformed(
            "stl-count",
            {
                "count-most.stl": binary_stl(CUBE_CORNERS, count=2**32 - 1),
                "count-half.stl": binary_stl(CUBE_CORNERS, count=2**31),
                "count-one-more.stl": binary_stl(CUBE_CORNERS, count=13),
                "count-one-less.stl": binary_stl(CUBE_CORNERS, count=11),
                "count-none.stl": binary_stl(CUBE_CORNERS, count=0),
                "count-solid.stl": binary_stl(CUBE_CORNERS, header=b"solid cube", count=2**32 - 1),
                "count-header-only.stl": binary_stl([], count=2**32 - 1),
            },
        ),
        *malformed(
            "binary-count",
            {
                "count-vertices.off": off(counts=(MOST, 6, 0)),
                "count-faces.off": off(counts=(8, MOST, 0)),
                "count-both.off": off(counts=(MOST, MOST, 0)),
                "count-long.off": off(counts=("9" * 400, 6, 0)),
                "count-digits.off": off(counts=("9" * 5000, 6, 0)),
                "count-negative.off": off(counts=(-8, 6, 0)),
                "count-fraction.off": off(counts=(8.5, 6, 0)),
                "count-few-vertices.off": off(counts=(7, 6, 0)),
                "count-few-faces.off": off(counts=(8, 5, 0)),
                "count-corners.off": off().replace(b"\n4 ", b"\n4000000000 ", 1),
                "count-corners-negative.off": off().replace(b"\n4 ", b"\n-4 ", 1),
                "count-vertices.ply": binary_ply(counts=(MOST, 6)),
                "count-faces.ply": binary_ply(counts=(8, MOST)),
                "count-vertices-big-endian.ply": binary_ply(counts=(MOST, 6), order=">"),
                "count-faces-big-endian.ply": binary_ply(counts=(8, MOST), order=">"),
                "count-corners.ply": ply_header(3, 1, "binary_little_endian", face=WIDE) + corners + triangle,
                "count-corners-signed.ply": ply_header(
                    3, 1, "binary_little_endian", face=("list int int vertex_indices",)
                )
                + corners
                + struct.pack("<i3i", -3, 0, 1, 2),
                "count-one-more-face.ply": binary_ply(counts=(8, 7)),
                "count-one-less-face.ply": binary_ply(counts=(8, 5)),
                "count-other-element.ply": ply_header(
                    3, 1, "binary_little_endian", more=(f"element junk {MOST}", "property list uchar int x")
                ),
            },
        ),
        *malformed(
            "ascii-count",
            {
                "count-vertices-ascii.ply": ply(counts=(MOST, 6)),
                "count-faces-ascii.ply": ply(counts=(8, MOST)),
                "count-digits-ascii.ply": ply(counts=("9" * 5000, 6)),
                "count-one-more-ascii.ply": ply(counts=(8, 7)),
                "count-one-less-ascii.ply": ply(counts=(8, 5)),
                "count-corners-ascii.ply": ply().replace(b"\n4 ", b"\n4000000000 ", 1),
                "count-corners-negative-ascii.ply": ply().replace(b"\n4 ", b"\n-1 ", 1),
                "count-corners-short-ascii.ply": ply().replace(b"\n4 ", b"\n5 ", 1),
            },
        ),
    ]


def _large_indices() -> list[Hostile]:
    files = {}
    for number in (8, 255, 2**31 - 1):
        faces = [*TRIANGLES.tolist()[:11], [0, 1, number]]
        files |= {
            f"index-{number}.obj": obj(polygons=faces),
            f"index-{number}.off": off(polygons=faces),
            f"index-{number}.ply": binary_ply(polygons=faces),
            f"index-{number}-ascii.ply": ply(polygons=faces),
        }
    for number in (2**31, 2**32, 2**63, 2**64 + 1):
        faces = [*TRIANGLES.tolist()[:11], [0, 1, number]]
        files |= {
            f"index-{number}.obj": obj(polygons=faces),
            f"index-{number}.off": off(polygons=faces),
            f"index-{number}-ascii.ply": ply(polygons=faces),
        }
    for number in (8, 255, 65_535):
        files[f"index-{number}.glb"] = glb(indices=[0, 1, number])
    files["index-polygon.off"] = off(polygons=[*SQUARES.tolist()[:5], [1, 5, 7, 8]])
    return malformed("index-large", files)


def _signed_indices() -> list[Hostile]:
    faces = [*TRIANGLES.tolist()[:11], [0, 1, -1]]
    relative = lines(CUBE, "v ") + lines(TRIANGLES - 8, "f ")
    return [
        *malformed(
            "index-negative",
            {
                "negative.off": off(polygons=faces),
                "negative.ply": binary_ply(polygons=faces),
                "negative-big-endian.ply": binary_ply(polygons=faces, order=">"),
                "negative-ascii.ply": ply(polygons=faces),
                "negative-far.off": off(polygons=[[0, 1, -(2**31)], *TRIANGLES.tolist()]),
                "negative-past-the-first.obj": obj() + b"f -9 -1 -2\n",
                "negative-before-any.obj": b"f -1 -2 -3\n" + obj(),
            },
        ),
        *stored(
            "index-negative",
            {"relative.obj": relative.encode(), "relative-textured.obj": obj() + b"f -1/-1/-1 -2/1 -3//2\n"},
        ),
        *malformed(
            "index-zero",
            {
                "zero.obj": obj() + b"f 0 1 2\n",
                "zero-last.obj": obj() + b"f 1 2 0\n",
                "zero-textured.obj": obj() + b"f 0/1/1 1/1/1 2/1/1\n",
                "zero-alone.obj": lines(CUBE, "v ").encode() + lines(TRIANGLES, "f ").encode(),
                "zero-minus.obj": obj() + b"f -0 1 2\n",
            },
        ),
    ]


def _no_faces() -> list[Hostile]:
    vertices = lines(CUBE, "v ").encode()
    lone = ply_header(8, 0, face=("list uchar int vertex_indices",)).partition(b"element face")[0]
    return refused(
        "no-faces",
        "no-triangles",
        {
            "none.stl": binary_stl([]),
            "none-ascii.stl": stl([]),
            "cloud.obj": vertices,
            "lines.obj": vertices + b"l 1 2 3 4\np 5\n",
            "pairs.obj": vertices + b"f 1 2\nf 3 4\n",
            "cloud.off": off(polygons=[]),
            "pairs.off": off(polygons=[[0, 1], [2, 3], [4]]),
            "cloud.ply": binary_ply(polygons=[]),
            "cloud-ascii.ply": ply(polygons=[]),
            "cloud-no-element.ply": lone + b"end_header\n" + lines(CUBE).encode(),
            "pairs.ply": binary_ply(polygons=[[0, 1], [2, 3]]),
            "nothing.ply": ply(vertices=[], polygons=[]),
            "nothing.off": b"OFF\n0 0 0\n",
            "comments.obj": b"# nothing but this\n" * 100,
        },
    )


def _container() -> list[Hostile]:
    facet = stl(CUBE_CORNERS[:1]).partition(b"\n")[2].rpartition(b"endsolid")[0]
    groups = lines(TRIANGLE, "v ").encode()
    return refused(
        "parts",
        "mesh-too-complex",
        {
            "solids-8000.stl": lambda: (b"solid a\n" + facet + b"endsolid a\n") * 8_000,
            "solids-40000.stl": lambda: (b"solid a\n" + facet + b"endsolid a\n") * 40_000,
            "solids-empty.stl": lambda: b"solid\nendsolid\n" * 40_000,
            "groups.obj": lambda: groups + b"g a\nf 1 2 3\n" * 20_000,
            "objects.obj": lambda: groups + b"o a\nf 1 2 3\n" * 20_000,
            "materials.obj": lambda: groups + b"usemtl a\nf 1 2 3\n" * 20_000,
        },
    )
