"""Archives, XML, 3MF and STEP: packages that stand for more than they are, entities that lead elsewhere."""

import bz2
import gzip
import json
import lzma
import struct
import zlib

from tests.core.io.files import CUBE, PLAIN, TRIANGLES, binary_stl, gltf, obj, off, ply
from tests.core.io.step_files import Step, step_box
from tests.core.io.threemf_files import (
    MALFORMED,
    RELS,
    components,
    mesh,
    model,
    nested,
    package,
    thing,
    with_coordinate,
)
from tests.service.jobs.support import pack

ENTITIES = b"".join(
    b'<!ENTITY %c "%s">' % (97 + i, b"lol" if i == 0 else b"&%c;" % (96 + i) * 10) for i in range(10)
)
XML = b'<?xml version="1.0"?>\n<!DOCTYPE x [%b]>\n<COLLADA>&%b;</COLLADA>\n'
OUTSIDE = XML % (b'<!ENTITY e SYSTEM "file:///etc/passwd">', b"e")
DOCUMENTS = {
    "entities": XML % (ENTITIES, b"j"),
    "outside": OUTSIDE,
    "remote": OUTSIDE.replace(b"file:///etc/passwd", b"http://127.0.0.1:1/x"),
}
OUTSIDE_BUFFER = {"uri": "../../etc/passwd", "byteLength": 168}
STL = binary_stl(CUBE[TRIANGLES])
SEVENZIP = b"7z\xbc\xaf\x27\x1c" + bytes(100)
PICKLE = b"cos\nsystem\n(S'true'\ntR."
SHEET = thing(1, mesh([*CUBE] * 500, [(n, n + 1, n + 2) for n in range(3_990)]))
BOX = step_box()
NOTHING = Step()
NOTHING.product("nothing", [], NOTHING.context("millimetre"))


def zip_bomb(inside: str = "mesh.stl", size: int = 6 << 30) -> bytes:
    """Return a ZIP of one file of zeros, made without making them: the same megabytes again and again."""
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
    return local + central + b"PK\x05\x06" + struct.pack("<HHHHIIH", 0, 0, 1, 1, len(central), len(local), 0)


def brackets() -> bytes:
    """Return brackets in brackets, over which OpenCASCADE overflows its stack, and the reader ends."""
    head = b"ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nENDSEC;\nDATA;\n"
    return head + b"#1=A" + b"(" * 100_000 + b")" * 100_000 + b";\nENDSEC;\nEND-ISO-10303-21;\n"


def _malformed(*names: str) -> dict[str, bytes]:
    return {f"{name.replace(' ', '-')}.3mf": MALFORMED[name] for name in names}


def _referring(entity: bytes, step: bytes = BOX) -> bytes:
    return step.replace(b"DATA;\n", b"DATA;\n#9000=%b('/etc/passwd','','',#9001,'','');\n" % entity)


CASES = {
    ("archive", "unknown-format"): {
        "bomb.zae": lambda: zip_bomb("scene.dae"),
        "mesh.zae": pack({"scene.dae": OUTSIDE}),
        "mesh.stl.gz": gzip.compress(STL, mtime=0),
        "mesh.tar": bytes(1024),
        "mesh.7z": SEVENZIP,
        "mesh.pickle": PICKLE,
        "mesh.npz": pack({"a.npy": PICKLE}),
    },
    ("archive", "malformed-mesh"): {
        "bomb.zip": zip_bomb,
        "mesh.zip": pack({"mesh.stl": STL}),
        "mesh.stl.zip": pack({"../../../etc/cron.d/mesh.stl": STL}),
        "two.zip": pack({"a.gltf": b"{}", "b.gltf": b"{}"}),
        "mesh.3mf": pack({"3D/3dmodel.model": DOCUMENTS["entities"]}),
        "mesh.step": b"ISO-10303-21;\n",
        "bomb-called.stl": zip_bomb,
        "bomb-called.glb": zip_bomb,
        "zip-called.obj": pack({"mesh.obj": obj()}),
        "zip-called.ply": pack({"mesh.ply": ply()}),
        "gzip-called.off": gzip.compress(off(), mtime=0),
        "gzip-called.ply": lambda: gzip.compress(bytes(64 << 20), mtime=0),
        "bzip2-called.obj": bz2.compress(obj()),
        "xz-called.stl": lzma.compress(STL),
        "7z-called.stl": SEVENZIP,
        "zip-behind-a-header.stl": binary_stl([], header=b"PK\x03\x04") + pack({"mesh.stl": STL}),
        **_malformed("a damaged part", "no directory", "shorter than it says", "longer than it says"),
        **_malformed("cut in the XML", "two parts of one name"),
    },
    ("archive", "mesh-too-complex"): {
        "bomb.3mf": lambda: zip_bomb("3D/3dmodel.model"),
        "bomb-of-a-gltf.zip": lambda: zip_bomb("mesh.gltf"),
        "components.3mf": lambda: package(
            model(thing(1) + thing(2, components(*[(1, None)] * 1_000_000)), [(2, None)])
        ),
        "members.3mf": lambda: package(parts={str(number): "" for number in range(100_000)}),
        # 900 MB in one.
        "spaces.3mf": lambda: package(" " * 900_000_000),
    },
    ("xml", "unknown-format"): {
        f"{name}.{ending}": text
        for name, text in DOCUMENTS.items()
        for ending in ("dae", "x3d", "xml", "svg", "amf", "xaml")
    },
    ("xml", "malformed-mesh"): {
        **{f"{name}.{format}": text for name, text in DOCUMENTS.items() for format in PLAIN},
        **_malformed(
            "billion laughs", "an external entity", "a DTD elsewhere", "laughs in the relationships"
        ),
    },
    ("index-large", "malformed-mesh"): _malformed("index too large", "an index of 4e9", "an index of 1e30"),
    ("index-negative", "malformed-mesh"): _malformed("a negative index"),
    ("instances", "malformed-mesh"): _malformed("its own component", "a circle", "a circle across parts"),
    ("instances", "mesh-too-complex"): {
        "layers.3mf": lambda: package(model(nested(12), [(12, None)])),
        "items.3mf": lambda: package(model(items=[(1, None)] * 100_000)),
        "sheets.3mf": lambda: package(model(SHEET, [(1, None)] * 4_000)),
    },
    ("non-finite", "non-finite-coordinates"): {
        f"{value}.3mf": with_coordinate(value) for value in ("NaN", "inf", "-inf", "1e999")
    },
    ("empty", "empty-file"): {"empty.3mf": b"", "empty.step": b""},
    ("no-faces", "no-triangles"): {"no-build.3mf": package(model("", ())), "nothing.step": NOTHING.data()},
    ("strange", ""): {
        "cube.3mf": package(),
        "box.step": BOX,
        "a-path-out-of-the-package.3mf": package(rels=RELS.replace("/3D/3dmodel.model", "../../etc/passwd")),
    },
    ("cut", "malformed-mesh"): {
        **{f"cut-{share}.step": BOX[: len(BOX) * share // 100] for share in (1, 10, 50, 84, 99)},
        "prose.step": b"Dear Sir or Madam,\n",
        "header.stp": b"ISO-10303-21;\nHEADER;\n",
    },
    # What is in other files is left out.
    ("reference", ""): {
        "elsewhere.step": _referring(b"DOCUMENT_FILE"),
        "elsewhere-short.step": _referring(b"DCMFL"),
    },
    ("reference", "external-reference"): {
        "elsewhere-alone.step": _referring(b"DOCUMENT_FILE", NOTHING.data()),
        "beside.zip": pack({"a.gltf": json.dumps({**gltf()[0], "buffers": [OUTSIDE_BUFFER]}).encode()}),
    },
    ("nested", "malformed-mesh"): {"brackets.step": brackets},
}
