"""Files of every format: no bytes, a part, another format's bytes, odd numbers, odd bodies."""

from functools import partial

import numpy as np

from core.io import write_mesh
from core.mesh.mesh import Mesh
from tests.core.io.files import CUBE, PLAIN, TRIANGLES, binary_ply, binary_stl, glb, obj, off, ply, stl
from tests.core.shapes import folded, rectangle

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
WRITERS = {
    ".stl": lambda vertices, faces: binary_stl(np.asarray(vertices)[faces]),
    "-ascii.stl": lambda vertices, faces: stl(np.asarray(vertices)[faces]),
    ".obj": obj,
    ".off": off,
    ".ply": binary_ply,
    "-ascii.ply": ply,
    ".glb": glb,
}
"""By the end of a file's name."""
SOUND = {end: write(CUBE, TRIANGLES) for end, write in WRITERS.items()}


def loose(count: int = 20_000) -> Mesh:
    """So many triangles that share nothing, of one size, scattered."""
    places = np.random.default_rng(1).uniform(0, 100, (count, 1, 3))
    return Mesh((places + TRIANGLE).reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def moebius(steps: int = 40) -> Mesh:
    """A strip with one side: three vertices across it, the last of which meet the first upside down."""
    angle, across = 2 * np.pi * np.arange(steps)[:, None] / steps, np.array([-0.3, 0.0, 0.3])
    radius = 1 + across * np.cos(angle / 2)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), across * np.sin(angle / 2)], -1)
    rows = np.vstack([np.arange(3 * steps).reshape(-1, 3), [[2, 1, 0]]])
    a, b, c, d = rows[:-1, :-1], rows[1:, :-1], rows[:-1, 1:], rows[1:, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([c, b, d], -1)])
    return Mesh(points.reshape(-1, 3), faces.reshape(-1, 3))


STRANGE = {
    "triangle": lambda: Mesh(TRIANGLE, [[0, 1, 2]]),
    "flat": lambda: rectangle(1, 1, 11, 11),
    "edge": folded,
    "moebius": moebius,
    "loose": loose,
}
WITHOUT_AREA = {
    "line": (np.outer(np.arange(6.0), [1.0, 2.0, 3.0]), np.arange(4)[:, None] + np.arange(3)),
    "point": (np.full_like(CUBE, 0.25), TRIANGLES),
    "repeated": (CUBE, np.array([[0, 0, 1], [2, 2, 2], [3, 4, 3]])),
}
NO_MESH = {
    "picture": b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8,
    "program": b"\x7fELF\x02\x01\x01" + bytes(200),
    "prose": b"Dear Sir or Madam,\n\nplease find the mesh attached.\n" * 20,
}
FOREIGN = {f"{name}.{format}": data for name, data in NO_MESH.items() for format in PLAIN} | {
    f"{end[1:].replace('.', '-')}-called.{format}": data
    for end, data in SOUND.items()
    for format in PLAIN
    if not end.endswith(format)
}
# Prose is an OBJ without triangles.
TEXT = {"prose.obj"}
CUT = {
    f"cut-{share}{end}": data[: len(data) * share // 100]
    for end, data in SOUND.items()
    for share in (3, 50, 97)
    if end != ".obj" and (end, share) not in {(".stl", 3), (".stl", 97)}
}


def with_value(value: float) -> np.ndarray:
    """The cube with one coordinate replaced."""
    changed = CUBE.copy()
    changed[3, 1] = value
    return changed


NUMBERS = {
    f"{name}{end}": write(with_value(value), TRIANGLES)
    for end, write in WRITERS.items()
    for name, value in {"nan": np.nan, "inf": np.inf, "minus-inf": -np.inf}.items()
} | {
    f"overflow{end}": SOUND[end].replace(b"\n" + line + b"1.0", b"\n" + line + b"1e999", 1)
    for end, line in {".obj": b"v ", ".off": b"", "-ascii.ply": b"", "-ascii.stl": b"    vertex "}.items()
}
SCALE = {"scale": [1e200, 1e200, 1e200], "mesh": 0}

CASES = {
    ("empty", "empty-file"): {
        f"{name}.{format}": data
        for name, data in {"empty": b"", "zeros": bytes(4096), "newlines": b"\n" * 5000}.items()
        for format in PLAIN
    },
    ("cut", "malformed-mesh"): {
        **CUT,
        **{name: data for name, data in FOREIGN.items() if name not in TEXT},
        "cut-vertex.obj": SOUND[".obj"][:9],
        "cut-face.obj": SOUND[".obj"] + b"f 1 2 -",
    },
    # The triangles before the last one are whole.
    ("cut", ""): {"cut-97.stl": SOUND[".stl"][:-20]},
    ("cut", "no-triangles"): {
        **{name: FOREIGN[name] for name in TEXT},
        "cut-before-faces.obj": SOUND[".obj"].partition(b"f")[0],
    },
    ("non-finite", "non-finite-coordinates"): {
        **NUMBERS,
        "overflow.glb": glb(nodes=[{"scale": SCALE["scale"], "children": [1]}, SCALE]),
    },
    ("non-finite", "degenerate-mesh"): {
        "huge.off": off(1e200 * CUBE),
        "huge.obj": obj(1e31 * CUBE),
        "huge.glb": glb(nodes=[SCALE]),
        "huge.stl": binary_stl(1e31 * CUBE[TRIANGLES]),
    },
    # A normal or a colour may be no number: it is not read.
    ("non-finite", ""): {
        "nan-in-a-normal.stl": SOUND[".stl"][:84] + np.float32(np.nan).tobytes() * 3 + SOUND[".stl"][96:]
    },
    ("degenerate", "degenerate-mesh"): {
        f"{body}{end}": write(*mesh) for body, mesh in WITHOUT_AREA.items() for end, write in WRITERS.items()
    },
    ("strange", ""): {
        f"{body}.{format}": partial(lambda make, format: write_mesh(make(), format), make, format)
        for body, make in STRANGE.items()
        for format in PLAIN
    },
}
