"""Sound files of every format, and seeded changes to them."""

import re
import struct
import zipfile
from functools import cache

import numpy as np

from core.io import write_mesh
from core.mesh.mesh import Mesh
from tests.core.io.files import CUBE, PLAIN, SQUARES, binary_ply, glb, obj, off, ply, ply_header, stl
from tests.core.io.gltf_files import Gltf
from tests.core.io.threemf_files import package
from tests.gallery import make_body

SHAPES = {"cup": 300, "octopus": 500, "pliers": 400}
"""Kinds of the gallery, and about how many vertices each has: few, so that many can be embedded."""

NUMBER = re.compile(rb"(?<![\w.+-])[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?(?![\w.])")
WORDS = [
    *(b"nan", b"inf", b"-inf", b"1e999", b"-1e999", b"1e308", b"1e-320", b"1e31", b"0", b"-0", b"-1", b"1"),
    *(b"3", b"255", b"65536", b"2147483648", b"4294967295", b"-4294967296", b"99999999999999999999", b""),
    *(b"0x1", b"1_0", b"1,5", b"--1", b"1.5.2", b"+", b"x", b"#", b"\\\n", b"/", b"1/0/0", b"\n", b"\0"),
    *(b"[", b"}", b'"', b"solid", b"f "),
]
FOUR_BYTES = [
    *(struct.pack("<f", value) for value in (np.nan, np.inf, -np.inf, 3.4e38, -3.4e38, 1e-40, 0.0, 1e31)),
    *(struct.pack("<i", value) for value in (-1, -(2**31), 2**31 - 1, 0, 1, 255, 65_535, 65_536)),
]


@cache
def sources():
    """Every shape in every format, binary and text: each a format, and bytes."""
    files = []
    for label, size in SHAPES.items():
        mesh = make_body(label, vertices=size).rest
        vertices, faces = np.round(mesh.vertices, 5), mesh.faces
        files += [(format, write_mesh(Mesh(vertices, faces), format)) for format in PLAIN]
        files += [
            ("stl", stl(vertices[faces], name=label)),
            ("ply", ply(vertices, faces)),
            ("ply", binary_ply(vertices, faces, order=">")),
            ("obj", b"mtllib a.mtl\no a\n" + obj(vertices, faces).replace(b"\nf ", b"\nvn 0 0 1\nf ", 1)),
            ("off", off(vertices, faces, header="COFF\n")),
            ("glb", glb(vertices, faces, nodes=[{"children": [1]}, {"mesh": 0, "scale": [1, 2, 1]}])),
        ]
    return tuple(files)


@cache
def small_sources():
    """Small files of more kinds, of squares and in packages among them."""
    return (
        ("3mf", package()),
        ("3mf", package(method=zipfile.ZIP_STORED)),
        ("stl", stl(CUBE[SQUARES[:, :3]])),
        ("obj", obj()),
        ("off", off()),
        ("ply", ply()),
        ("ply", binary_ply(CUBE, [*SQUARES, [0, 1, 2]])),
        ("glb", glb(nodes=[{"children": [1], "scale": [1, 2, 3]}, {"mesh": 0, "translation": [1, 0, 0]}])),
        ("glb", embedded_gltf()),
        ("off", off(np.hstack([2 * CUBE, np.full((8, 1), 2.0)]), header="4OFF\n")),
        ("ply", ply_of_lists()),
    )


def embedded_gltf():
    """A JSON with its buffer inside."""
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh())
    return gltf.embedded()


def ply_of_lists():
    """A binary PLY with lists of unequal lengths among its vertices, and lengths and indices in floats."""
    vertex = ("list uchar short views", "float x", "float y", "float z")
    head = ply_header(8, 6, "binary_big_endian", vertex, ("list float double vertex_indices",))
    vertices = (struct.pack(f">B{n % 3}h3f", n % 3, *range(n % 3), *row) for n, row in enumerate(CUBE))
    faces = (struct.pack(">f4d", 4, *row) for row in SQUARES)
    return head + b"".join([*vertices, *faces])


def mutation(files, seed, number):
    """One of some files with mostly one change, sometimes up to three, of kinds drawn anew each time."""
    rng = np.random.default_rng([seed, number])
    format, data = files[number % len(files)]
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        data = KINDS[int(rng.integers(len(KINDS)))](data, rng)
    return format, data


def flip_bits(data, rng):
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 5)) if data else 0):
        changed[_place(len(data), rng)] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def truncate(data, rng):
    return data[: int(rng.integers(0, len(data) + 1))]


def splice(data, rng):
    """A piece of another file, or of this one, in place of a piece."""
    files = sources()
    other = data if rng.random() < 0.5 else files[int(rng.integers(len(files)))][1]
    start, at = (_place(len(each) + 1, rng) for each in (other, data))
    length, gone = (int(each) for each in rng.integers(0, 400, 2))
    return data[:at] + other[start : start + length] + data[at + gone :]


def edit_number(data, rng):
    """A word that is no number, or one that stands elsewhere, for a number; in binary, other four bytes."""
    at = _place(len(data) + 1, rng)
    found = NUMBER.search(data, at) if b"\0" not in data else None
    if found is None:
        at -= at % 4
        return data[:at] + FOUR_BYTES[int(rng.integers(len(FOUR_BYTES)))] + data[at + 4 :]
    other = NUMBER.search(data, _place(len(data) + 1, rng)) or found
    word = other[0] if rng.random() < 0.5 else WORDS[int(rng.integers(len(WORDS)))]
    return data[: found.start()] + word + data[found.end() :]


def insert_word(data, rng):
    at = _place(len(data) + 1, rng)
    return data[:at] + WORDS[int(rng.integers(len(WORDS)))] + data[at + int(rng.integers(9)) :]


def _place(length, rng):
    """Where to change something: the head of a file decides most, so that one change in five is there."""
    return int(rng.integers(min(length, 600) if rng.random() < 0.2 else length)) if length else 0


KINDS = [flip_bits, flip_bits, truncate, splice, insert_word, edit_number, edit_number, edit_number]
