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
from tests.soak.hostile.every_format import TRIANGLE

MOST = 4_000_000_000
STL_COUNTS = {"most": 2**32 - 1, "half": 2**31, "one-more": 13, "one-less": 11, "none": 0}
COUNTS = {"vertices": (MOST, 6), "faces": (8, MOST), "one-more": (8, 7)}
TEXT_COUNTS = {
    **COUNTS,
    "both": (MOST, MOST),
    "long": ("9" * 400, 6),
    "digits": ("9" * 5000, 6),
    "negative": (-8, 6),
    "fraction": (8.5, 6),
    "few-vertices": (7, 6),
}
CORNERS = {"most": b"4000000000", "negative": b"-1", "more": b"5"}
BINARY_CORNERS = {"most": ("uint", struct.pack("<I", MOST)), "negative": ("int", struct.pack("<i", -3))}


def _binary_corners(kind: str, declared: bytes) -> bytes:
    """Return a triangle in binary PLY that declares another number of corners."""
    head = ply_header(3, 1, "binary_little_endian", face=(f"list {kind} int vertex_indices",))
    return head + TRIANGLE.astype("<f4").tobytes() + declared + struct.pack("<3i", 0, 1, 2)


def _indices() -> dict[str, bytes]:
    """Return cubes whose last corner does not exist."""
    files = {f"index-{number}.glb": glb(indices=[0, 1, number]) for number in (8, 255, 65_535)}
    for number in (8, 255, 2**31 - 1, 2**31, 2**32, 2**63, 2**64 + 1):
        faces = [*TRIANGLES.tolist()[:11], [0, 1, number]]
        files |= {
            f"index-{number}{end}": write(polygons=faces)
            for end, write in {".obj": obj, ".off": off, "-ascii.ply": ply, ".ply": binary_ply}.items()
            if end != ".ply" or number < 2**31
        }
    return files | {"index-polygon.off": off(polygons=[*SQUARES.tolist()[:5], [1, 5, 7, 8]])}


VERTICES = lines(CUBE, "v ").encode()
NEGATIVE = [*TRIANGLES.tolist()[:11], [0, 1, -1]]
PAIRS = [[0, 1], [2, 3]]
FACET = stl(CUBE[TRIANGLES][:1]).partition(b"\n")[2].rpartition(b"endsolid")[0]
THREE = lines(TRIANGLE, "v ").encode()
NO_FACES = ply_header(8, 0).partition(b"element face")[0] + b"end_header\n" + lines(CUBE).encode()

CASES = {
    # The triangles that are there are read.
    ("stl-count", ""): {
        **{f"count-{n}.stl": binary_stl(CUBE[TRIANGLES], count=count) for n, count in STL_COUNTS.items()},
        "count-solid.stl": binary_stl(CUBE[TRIANGLES], header=b"solid cube", count=2**32 - 1),
    },
    ("stl-count", "malformed-mesh"): {
        "count-cut.stl": binary_stl(CUBE[TRIANGLES], count=2**32 - 1)[:-20],
        "count-header-only.stl": binary_stl([], count=2**32 - 1),
    },
    ("binary-count", ""): {
        "count-one-less.off": off(counts=(8, 5, 0)),
        "count-one-less.ply": binary_ply(counts=(8, 5)),
        "count-one-less-ascii.ply": ply(counts=(8, 5)),
    },
    ("binary-count", "malformed-mesh"): {
        **{f"count-{name}.off": off(counts=(*counts, 0)) for name, counts in TEXT_COUNTS.items()},
        **{f"count-{name}.ply": binary_ply(counts=counts) for name, counts in COUNTS.items()},
        **{f"count-{name}-big-endian.ply": binary_ply(counts=c, order=">") for name, c in COUNTS.items()},
        **{f"corners-{name}.off": off().replace(b"\n4 ", b"\n%b " % n, 1) for name, n in CORNERS.items()},
        **{f"corners-{name}.ply": _binary_corners(*declared) for name, declared in BINARY_CORNERS.items()},
        "count-other-element.ply": ply_header(
            3, 1, "binary_little_endian", more=(f"element junk {MOST}", "property list uchar int x")
        ),
    },
    ("ascii-count", "malformed-mesh"): {
        **{f"count-{name}-ascii.ply": ply(counts=counts) for name, counts in TEXT_COUNTS.items()},
        **{
            f"corners-{name}-ascii.ply": ply().replace(b"\n4 ", b"\n%b " % n, 1)
            for name, n in CORNERS.items()
        },
    },
    ("index-large", "malformed-mesh"): _indices(),
    ("index-negative", "malformed-mesh"): {
        "negative.off": off(polygons=NEGATIVE),
        "negative.ply": binary_ply(polygons=NEGATIVE),
        "negative-big-endian.ply": binary_ply(polygons=NEGATIVE, order=">"),
        "negative-ascii.ply": ply(polygons=NEGATIVE),
        "negative-far.off": off(polygons=[[0, 1, -(2**31)], *TRIANGLES.tolist()]),
        "negative-past-the-first.obj": obj() + b"f -9 -1 -2\n",
        "negative-before-any.obj": b"f -1 -2 -3\n" + obj(),
    },
    ("index-negative", ""): {
        "relative.obj": VERTICES + lines(TRIANGLES - 8, "f ").encode(),
        "relative-textured.obj": obj() + b"f -1/-1/-1 -2/1 -3//2\n",
    },
    ("index-zero", "malformed-mesh"): {
        "zero.obj": obj() + b"f 0 1 2\n",
        "zero-last.obj": obj() + b"f 1 2 0\n",
        "zero-textured.obj": obj() + b"f 0/1/1 1/1/1 2/1/1\n",
        "zero-alone.obj": VERTICES + lines(TRIANGLES, "f ").encode(),
        "zero-minus.obj": obj() + b"f -0 1 2\n",
    },
    ("no-faces", "no-triangles"): {
        "none.stl": binary_stl([]),
        "none-ascii.stl": stl([]),
        "cloud.obj": VERTICES,
        "lines.obj": VERTICES + b"l 1 2 3 4\np 5\n",
        "pairs.obj": obj(polygons=PAIRS),
        "cloud.off": off(polygons=[]),
        "pairs.off": off(polygons=[*PAIRS, [4]]),
        "cloud.ply": binary_ply(polygons=[]),
        "cloud-ascii.ply": ply(polygons=[]),
        "cloud-no-element.ply": NO_FACES,
        "pairs.ply": binary_ply(polygons=PAIRS),
        "nothing.ply": ply(vertices=[], polygons=[]),
        "nothing.off": b"OFF\n0 0 0\n",
        "comments.obj": b"# nothing but this\n" * 100,
    },
    ("parts", "no-triangles"): {"solids-empty.stl": b"solid\nendsolid\n" * 40_000},
    ("parts", ""): {
        "solids-8000.stl": (b"solid a\n" + FACET + b"endsolid a\n") * 8_000,
        "solids-40000.stl": lambda: (b"solid a\n" + FACET + b"endsolid a\n") * 40_000,
        **{
            f"{word}.obj": THREE + b"%b a\nf 1 2 3\n" % word.encode() * 20_000
            for word in ("g", "o", "usemtl")
        },
    },
}
