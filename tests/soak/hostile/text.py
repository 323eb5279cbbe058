"""Names that are paths, references in text, and text that is hard to read."""

from tests.core.io.files import CUBE, TRIANGLES, lines, obj, off, ply

SOUND = off(polygons=TRIANGLES)
VERTICES, FACES = lines(CUBE, "v ").encode(), lines(TRIANGLES + 1, "f ").encode()
MIB = 1 << 20

CASES = {
    # Paths are cut down to their last part; a shape that is stored has that for a name.
    ("name", ""): dict.fromkeys(
        (
            "/etc/passwd.off",
            "../../../../etc/passwd-up.off",
            "isoshape-data/isoshape.sqlite3.off",
            "C:\\Windows\\system32\\config.off",
            "file:///etc/hosts.off",
            "http://127.0.0.1:1/mesh.off",
            "a mesh; rm -rf *.off",
            "'; DROP TABLE shapes; --.off",
            "<script>alert(1)</script>.OFF",
            "%2e%2e%2fmesh.off",
            "con.off",
            "-o.off",
        ),
        SOUND,
    ),
    ("name", "unknown-format"): dict.fromkeys(
        (
            *("/etc/passwd", "../../isoshape-data/isoshape.sqlite3", "mesh", "mesh.", "mesh.off."),
            *(".off/mesh", "mesh.off;.txt", "mesh.py", "mesh.off\u202etxt"),
        ),
        SOUND,
    ),
    ("name", "bad-request-fields"): dict.fromkeys(("mesh.off/", "n" * 300 + ".off", "me\u0085sh.off"), SOUND),
    ("reference", ""): {
        "mtllib-root.obj": b"mtllib /etc/passwd\nusemtl a\n" + obj(),
        "mtllib-parent.obj": b"mtllib ../../../../etc/passwd\n" + obj(),
        "mtllib-http.obj": b"mtllib http://127.0.0.1:1/x.mtl\n" + obj(),
        "call.obj": b"call /etc/passwd\ncsh rm -rf .\n!touch x\n" + obj(),
        "map.obj": b"maplib /etc/passwd\nshadow_obj /etc/passwd\ntrace_obj /etc/passwd\n" + obj(),
        "texture-file.ply": ply(more=("comment TextureFile /etc/passwd", "obj_info ../../x")),
    },
    # Long lines, long numbers, many blanks; what a regular expression might take for ever over.
    ("nested", ""): {
        "blanks.obj": lambda: VERTICES + b" " * MIB + b"\n" * MIB + FACES,
        "blanks-in-a-line.obj": VERTICES.replace(b" ", b" " * 9_999, 3) + FACES,
        "comment-of-megabytes.obj": lambda: b"#" * (4 * MIB) + b"\n" + VERTICES + FACES,
        "digits.off": SOUND.replace(b"1.0", b"1." + b"0" * 100_000, 1),
        "polygon-of-100000.obj": lambda: (
            VERTICES + FACES + b"f " + b" ".join(b"%d" % (1 + i % 8) for i in range(99_999)) + b"\n"
        ),
        "lines-that-go-on.obj": VERTICES + b"f" + b" \\\n" * 9 + b"1 2 \\\n3\n" + FACES,
        "unused-vertices.off": lambda: off([*CUBE, *([[9, 9, 9]] * 100_000)], TRIANGLES),
        "utf-16.obj": (VERTICES + FACES).decode().encode("utf-16"),
        "comments.ply": ply(more=["comment " + "x" * 1000] * 500),
    },
    ("nested", "no-triangles"): {"solid-solid.stl": b"solid " * 100_000},
    ("nested", "malformed-mesh"): {
        "line-of-megabytes.off": lambda: b"OFF " + b"1 " * MIB,
        "line-of-megabytes.ply": lambda: b"ply\nformat ascii 1.0\n" + b"x" * (4 * MIB),
        "header-without-end.ply": lambda: b"ply\n" + b"comment x\n" * 400_000,
        "facets-without-end.stl": lambda: (
            b"solid\n" + b"facet normal 0 0 1 outer loop " * 100_000 + b"endsolid"
        ),
        "spaces.stl": lambda: b"solid\nfacet normal" + b" " * (4 * MIB) + b"endsolid\n",
        "polygon-too-far.obj": lambda: (
            VERTICES + b"f " + b" ".join(b"%d" % i for i in range(1, 100_001)) + b"\n"
        ),
        "word-for-a-number.obj": VERTICES + b"v a b c\n" + FACES,
        "thousands-sign.off": SOUND.replace(b"3 0", b"3 0_0", 1),
        "hexadecimal.off": SOUND.replace(b"1.0", b"0x1", 1),
        "zero-bytes.obj": VERTICES + b"\0" + FACES,
        "twice.ply": ply(vertex=("float x", "float y", "float z", "float x")),
        "type-unknown.ply": ply(vertex=("float x", "float y", "quad z")),
        "format-unknown.ply": ply().replace(b"ascii 1.0", b"binary_middle_endian 1.0"),
        "dimensions.off": off(header="4OFF\n", polygons=TRIANGLES),
    },
}
