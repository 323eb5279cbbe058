"""Archives, XML, names, references in text, and text that is hard to read."""

import bz2
import gzip
import io
import lzma
import struct
import zipfile
import zlib

from tests.core.io.files import CUBE, TRIANGLES, binary_stl, lines, obj, off, ply
from tests.soak.hostile.bodies import CUBE_CORNERS
from tests.soak.hostile.case import Hostile, malformed, refused, stored

ENTITIES = b"".join(
    b'<!ENTITY %c "%s">' % (97 + i, b"lol" if i == 0 else b"&%c;" % (96 + i) * 10) for i in range(10)
)
BOMB = b'<?xml version="1.0"?>\n<!DOCTYPE bomb [' + ENTITIES + b"]>\n<COLLADA>&j;</COLLADA>\n"
OUTSIDE = (
    b'<?xml version="1.0"?>\n<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>\n<COLLADA>&e;</COLLADA>\n'
)
REMOTE = OUTSIDE.replace(b"file:///etc/passwd", b"http://127.0.0.1:1/x")
GIB = 1 << 30


def cases() -> list[Hostile]:
    """All of them."""
    return [*_archives(), *_xml(), *_names(), *_text_references(), *_hard_text()]


def zip_bomb(size: int = 6 * GIB, inside: str = "mesh.stl") -> bytes:
    """A ZIP of one file of zeros, made without making them: the same compressed megabytes again and again."""
    block = 16 << 20
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    packed = packer.compress(bytes(block)) + packer.flush(zlib.Z_FULL_FLUSH)
    body = packed * (size // block) + zlib.compressobj(9, zlib.DEFLATED, -15).flush()
    name = inside.encode()
    sizes = struct.pack("<QQ", size, len(body))
    extra = struct.pack("<HH", 1, len(sizes)) + sizes
    common = struct.pack("<HHHHHIIIHH", 45, 0, 8, 0, 0, 0, 2**32 - 1, 2**32 - 1, len(name), len(extra))
    local = b"PK\x03\x04" + common + name + extra + body
    central = (
        b"PK\x01\x02" + struct.pack("<H", 45) + common + struct.pack("<HHHII", 0, 0, 0, 0, 0) + name + extra
    )
    end = b"PK\x05\x06" + struct.pack("<HHHHIIH", 0, 0, 1, 1, len(central), len(local), 0)
    return local + central + end


def _zipped(name: str, data: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo(name), data)
    return buffer.getvalue()


def _archives() -> list[Hostile]:
    mesh = binary_stl(CUBE_CORNERS)
    sevenzip = b"7z\xbc\xaf\x27\x1c" + bytes(100)
    return [
        *refused(
            "archive",
            "unknown-format",
            {
                "bomb.zip": zip_bomb,
                "bomb.zae": lambda: zip_bomb(inside="scene.dae"),
                "mesh.zip": _zipped("mesh.stl", mesh),
                "mesh.zae": _zipped("scene.dae", OUTSIDE),
                "mesh.stl.zip": _zipped("../../../etc/cron.d/mesh.stl", mesh),
                "mesh.stl.gz": gzip.compress(mesh, mtime=0),
                "mesh.tar": bytes(1024),
                "mesh.7z": sevenzip,
                "mesh.gltf": b"{}",
                "mesh.pickle": b"cos\nsystem\n(S'true'\ntR.",
                "mesh.npz": _zipped("a.npy", b"cos\nsystem\n(S'true'\ntR."),
            },
            status=415,
        ),
        *malformed(
            "archive",
            {
                "bomb.3mf": lambda: zip_bomb(inside="3D/3dmodel.model"),
                "mesh.3mf": _zipped("3D/3dmodel.model", BOMB),
                "mesh.step": b"ISO-10303-21;\n",
                "bomb-called.stl": zip_bomb,
                "bomb-called.glb": zip_bomb,
                "zip-called.obj": _zipped("mesh.obj", obj()),
                "zip-called.ply": _zipped("mesh.ply", ply()),
                "gzip-called.off": gzip.compress(off(), mtime=0),
                "gzip-called.ply": gzip.compress(bytes(64 << 20), mtime=0),
                "bzip2-called.obj": bz2.compress(obj()),
                "xz-called.stl": lzma.compress(mesh),
                "7z-called.stl": sevenzip,
                "zip-behind-a-header.stl": binary_stl([], header=b"PK\x03\x04") + _zipped("mesh.stl", mesh),
            },
        ),
    ]


def _xml() -> list[Hostile]:
    cases = []
    for name, text in {"entities": BOMB, "outside": OUTSIDE, "remote": REMOTE}.items():
        cases += refused(
            "xml",
            "unknown-format",
            {f"{name}.{ending}": text for ending in ("dae", "x3d", "xml", "svg", "amf", "xaml")},
            status=415,
        )
        cases += malformed("xml", {f"{name}.{format}": text for format in ("stl", "ply", "off", "glb")})
        cases += refused("xml", "no-triangles", {f"{name}.obj": text})
    return cases


def _names() -> list[Hostile]:
    """Paths are cut down to their last part; a shape that is stored has that for a name."""
    sound = off(polygons=TRIANGLES)
    return [
        *stored(
            "name",
            {
                "/etc/passwd.off": sound,
                "../../../../etc/passwd-up.off": sound,
                "isoshape-data/isoshape.sqlite3.off": sound,
                "C:\\Windows\\system32\\config.off": sound,
                "file:///etc/hosts.off": sound,
                "http://127.0.0.1:1/mesh.off": sound,
                "a mesh; rm -rf *.off": sound,
                "'; DROP TABLE shapes; --.off": sound,
                "<script>alert(1)</script>.OFF": sound,
                "%2e%2e%2fmesh.off": sound,
                "con.off": sound,
                "-o.off": sound,
            },
        ),
        *refused(
            "name",
            "unknown-format",
            {
                "/etc/passwd": sound,
                "../../isoshape-data/isoshape.sqlite3": sound,
                "mesh": sound,
                "mesh.": sound,
                "mesh.off.": sound,
                ".off/mesh": sound,
                "mesh.off;.txt": sound,
                "mesh.py": b"import os\n",
                "mesh.off\u202etxt": sound,
            },
            status=415,
        ),
        *refused(
            "name",
            "bad-request-fields",
            {"mesh.off/": sound, "n" * 300 + ".off": sound, "me\u0085sh.off": sound},
        ),
    ]


def _text_references() -> list[Hostile]:
    return stored(
        "reference",
        {
            "mtllib-root.obj": b"mtllib /etc/passwd\nusemtl a\n" + obj(),
            "mtllib-parent.obj": b"mtllib ../../../../etc/passwd\n" + obj(),
            "mtllib-http.obj": b"mtllib http://127.0.0.1:1/x.mtl\n" + obj(),
            "call.obj": b"call /etc/passwd\ncsh rm -rf .\n!touch x\n" + obj(),
            "map.obj": b"maplib /etc/passwd\nshadow_obj /etc/passwd\ntrace_obj /etc/passwd\n" + obj(),
            "texture-file.ply": ply(more=("comment TextureFile /etc/passwd", "obj_info ../../x")),
        },
    )


def _hard_text() -> list[Hostile]:
    """Long lines, long numbers, many blanks; what a regular expression might take for ever over."""
    vertices, faces = lines(CUBE, "v ").encode(), lines(TRIANGLES + 1, "f ").encode()
    megabyte = 1 << 20
    ring = range(1, 100_001)
    round_ = b"f " + b" ".join(b"%d" % (1 + i % 8) for i in range(99_999)) + b"\n"
    return [
        *stored(
            "nested",
            {
                "blanks.obj": lambda: vertices + b" " * megabyte + b"\n" * megabyte + faces,
                "blanks-in-a-line.obj": lambda: vertices.replace(b" ", b" " * 9_999, 3) + faces,
                "comment-of-megabytes.obj": lambda: b"#" * (4 * megabyte) + b"\n" + vertices + faces,
                "digits.off": off(polygons=TRIANGLES).replace(b"1.0", b"1." + b"0" * 100_000, 1),
                "polygon-of-100000.obj": lambda: vertices + faces + round_,
                "lines-that-go-on.obj": lambda: vertices + b"f" + b" \\\n" * 9 + b"1 2 \\\n3\n" + faces,
                "unused-vertices.off": lambda: off([*CUBE, *([[9, 9, 9]] * 100_000)], TRIANGLES),
                "comments.ply": lambda: ply(more=["comment " + "x" * 1000] * 500),
            },
        ),
        *malformed(
            "nested",
            {
                "line-of-megabytes.off": lambda: b"OFF " + b"1 " * megabyte,
                "line-of-megabytes.ply": lambda: b"ply\nformat ascii 1.0\n" + b"x" * (4 * megabyte),
                "header-without-end.ply": lambda: b"ply\n" + b"comment x\n" * 400_000,
                "facets-without-end.stl": lambda: (
                    b"solid\n" + b"facet normal 0 0 1 outer loop " * 100_000 + b"endsolid"
                ),
                "spaces.stl": lambda: b"solid\nfacet normal" + b" " * (4 * megabyte) + b"endsolid\n",
                "solid-solid.stl": lambda: b"solid " * 100_000,
                "polygon-too-far.obj": lambda: vertices + b"f " + b" ".join(b"%d" % i for i in ring) + b"\n",
                "word-for-a-number.obj": vertices + b"v a b c\n" + faces,
                "thousands-sign.off": off(polygons=TRIANGLES).replace(b"3 0", b"3 0_0", 1),
                "hexadecimal.off": off(polygons=TRIANGLES).replace(b"1.0", b"0x1", 1),
                "zero-bytes.obj": vertices + b"\0" + faces,
                "utf-16.obj": (vertices + faces).decode().encode("utf-16"),
                "twice.ply": ply(vertex=("float x", "float y", "float z", "float x")),
                "type-unknown.ply": ply(vertex=("float x", "float y", "quad z")),
                "format-unknown.ply": ply().replace(b"ascii 1.0", b"binary_middle_endian 1.0"),
                "dimensions.off": off(header="4OFF\n", polygons=TRIANGLES),
            },
        ),
    ]
