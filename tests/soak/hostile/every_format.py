"""Cases of every format: no bytes, a part, another format's bytes, odd numbers, odd bodies."""

from functools import partial

import numpy as np

from core.io import write_mesh
from core.mesh.mesh import Mesh
from tests.core.io.files import CUBE, PLAIN, TRIANGLES, binary_ply, binary_stl, glb, obj, off, ply, stl
from tests.soak.hostile.bodies import STRANGE, WITHOUT_AREA, with_value
from tests.soak.hostile.case import STORED, Hostile, malformed, refused, stored

WRITERS = {
    "stl": lambda vertices, faces: binary_stl(np.asarray(vertices)[faces]),
    "ascii.stl": lambda vertices, faces: stl(np.asarray(vertices)[faces]),
    "obj": obj,
    "off": off,
    "ply": binary_ply,
    "ascii.ply": ply,
    "glb": glb,
}
SOUND = {name: writer(CUBE, TRIANGLES) for name, writer in WRITERS.items()}
# With what begins a file's name: "ascii.stl" gives one that ends in -ascii.stl, "stl" in .stl.
NAME = {name: f"-{name}" if "." in name else f".{name}" for name in WRITERS}
NO_MESH = {
    "picture": b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8,
    "program": b"\x7fELF\x02\x01\x01" + bytes(200),
    "zeros": bytes(4096),
    "prose": b"Dear Sir or Madam,\n\nplease find the mesh attached.\n" * 20,
    "newlines": b"\n" * 5000,
}


def cases() -> list[Hostile]:
    """All of them."""
    return [*_empty(), *_cut(), *_misnamed(), *_no_mesh(), *_numbers(), *_bodies()]


def _empty() -> list[Hostile]:
    return refused("empty", "empty-file", {f"empty.{format}": b"" for format in PLAIN})


def _cut() -> list[Hostile]:
    """Cut short; any beginning of an OBJ that ends with a line is an OBJ."""
    cut = {
        f"cut-{share}{NAME[name]}": SOUND[name][: len(SOUND[name]) * share // 100]
        for name in WRITERS
        if name != "obj"
        for share in (3, 50, 97)
    }
    cases = malformed("cut", cut)
    cases += malformed("cut", {"cut-vertex.obj": SOUND["obj"][:9], "cut-face.obj": SOUND["obj"] + b"f 1 2 -"})
    return cases + refused("cut", "no-triangles", {"cut-before-faces.obj": SOUND["obj"].partition(b"f")[0]})


def _misnamed() -> list[Hostile]:
    """A sound file of each kind under the name of each other format; an OBJ is any text."""
    cases = []
    for name, data in SOUND.items():
        for format in PLAIN:
            if not name.endswith(format):
                kind = "no-triangles" if format == "obj" and b"\0" not in data else "malformed-mesh"
                cases += refused("cut", kind, {f"{name.replace('.', '-')}-called.{format}": data})
    return cases


def _no_mesh() -> list[Hostile]:
    cases = []
    for name, data in NO_MESH.items():
        for format in PLAIN:
            kind = "no-triangles" if format == "obj" and b"\0" not in data else "malformed-mesh"
            cases += refused("cut", kind, {f"{name}.{format}": data})
    return cases


def _numbers() -> list[Hostile]:
    """Numbers that are none. A normal or a colour may be one: it is not read."""
    values = {"nan": np.nan, "inf": np.inf, "minus-inf": -np.inf}
    files = {
        f"{value}{NAME[name]}": write(with_value(number), TRIANGLES)
        for name, write in WRITERS.items()
        for value, number in values.items()
    }
    for name, line in {"obj": b"v ", "off": b"", "ascii.ply": b"", "ascii.stl": b"    vertex "}.items():
        files["overflow" + NAME[name]] = SOUND[name].replace(
            b"\n" + line + b"1.0", b"\n" + line + b"1e999", 1
        )
    scale = [1e200, 1e200, 1e200]
    files["overflow.glb"] = glb(nodes=[{"scale": scale, "children": [1]}, {"mesh": 0, "scale": scale}])
    huge = {
        "huge.off": off(1e200 * CUBE),
        "huge.obj": obj(1e31 * CUBE),
        "huge.glb": glb(nodes=[{"mesh": 0, "scale": scale}]),
        "huge.stl": binary_stl(1e31 * CUBE[TRIANGLES]),
    }
    normals = SOUND["stl"][:84] + np.float32(np.nan).tobytes() * 3 + SOUND["stl"][96:]
    return [
        *refused("non-finite", "non-finite-coordinates", files),
        *refused("non-finite", "degenerate-mesh", huge),
        *stored("non-finite", {"nan-in-a-normal.stl": normals}),
    ]


def _bodies() -> list[Hostile]:
    cases = []
    for body, make in WITHOUT_AREA.items():
        for name, write in WRITERS.items():
            cases += refused("degenerate", "degenerate-mesh", {body + NAME[name]: write(*make())})
    for body, make in STRANGE.items():
        for format in PLAIN:
            # Twenty thousand parts take seconds to embed.
            slow = body == "loose" and format != "stl"
            cases.append(
                Hostile("strange", f"{body}.{format}", partial(_written, make, format), *STORED, slow)
            )
    return cases


def _written(make, format: str) -> bytes:
    return write_mesh(Mesh(*make()), format)
