"""Copies in STL, PLY, OFF and OBJ, in what their writers vary."""

import numpy as np

from core.mesh.mesh import Mesh
from tests.core.io.files import counted, lines, ply_header
from tests.soak.collections.copies import Copy, changed, fans, merged, split, whole

# STL


def stl_text(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """Several solids, some in capitals, without normals that fit."""
    mesh = changed(mesh, rng)
    text = "".join(
        f"solid part {n} facet\n"
        + "".join(
            "facet normal 0 0 0\nouter loop\n" + lines(triangle, "vertex ") + "endloop\nendfacet\n"
            for triangle in whole(piece).tolist()
        )
        + f"endsolid part {n}\n"
        for n, piece in enumerate(split(mesh, rng, 50))
    )
    return Copy((text.upper() if rng.random() < 0.3 else text).encode(), "stl", whole(mesh))


def stl_binary(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """A header that begins as text does, random normals and attributes."""
    mesh = changed(mesh, rng)
    facets = np.zeros(
        len(mesh.faces), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")]
    )
    facets["corners"] = whole(mesh)
    facets["normal"] = rng.normal(size=(len(facets), 3))
    facets["attributes"] = rng.integers(1 << 16, size=len(facets))
    header = b"solid of a program".ljust(80) + len(facets).to_bytes(4, "little")
    return Copy(header + facets.tobytes(), "stl", facets["corners"].astype(float))


# PLY


def ply_big_endian(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """Doubles, normals and colours, another element first, polygons of different sizes."""
    mesh = changed(mesh, rng)
    polygons = merged(mesh)
    names = ("double x", "double y", "double z", "float nx", "float ny", "float nz", "uchar red")
    head = ply_header(
        len(mesh.vertices),
        len(polygons),
        form="binary_big_endian",
        vertex=names,
        face=("uchar flags", "list uchar int vertex_indices"),
        more=(
            "comment made by hand",
            "element camera 2",
            "property float view",
            "property list uchar short seen",
        ),
    )
    rows = np.zeros(len(mesh.vertices), [("position", ">f8", 3), ("normal", ">f4", 3), ("red", "u1")])
    rows["position"] = mesh.vertices
    camera = np.array([0.5], ">f4").tobytes() + b"\2" + bytes(4)
    faces = b"".join(b"\7" + bytes([len(row)]) + np.array(row, ">i4").tobytes() for row in polygons)
    return Copy(head + 2 * camera + rows.tobytes() + faces, "ply", whole(mesh), misread=fans(mesh, polygons))


def ply_text(mesh: Mesh, rng: np.random.Generator, *, lists: bool) -> Copy:
    """Polygons of different sizes; lists among the vertices, or colours."""
    mesh = changed(mesh, rng)
    polygons = merged(mesh)
    more = ("list uchar int views",) if lists else ("uchar red", "uchar green", "uchar blue")
    vertices = [
        [*row, *([n % 3, *range(n % 3)] if lists else (1, 2, 3))]
        for n, row in enumerate(mesh.vertices.tolist())
    ]
    vertex = ("double x", "double y", "double z", *more)
    head = ply_header(len(vertices), len(polygons), vertex=vertex, face=("list uchar int vertex_index",))
    body = (lines(vertices) + lines(counted(polygons))).encode()
    return Copy(head + body, "ply", whole(mesh), misread=fans(mesh, polygons))


def ply_lists(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """Binary: lists of different lengths among the vertices, lengths and indices of faces in floats."""
    mesh = changed(mesh, rng)
    head = ply_header(
        len(mesh.vertices),
        len(mesh.faces),
        form="binary_little_endian",
        vertex=("list uchar int views", "double x", "double y", "double z"),
        face=("list float double vertex_indices",),
    )
    vertices = b"".join(
        bytes([n % 3]) + bytes(4 * (n % 3)) + row.tobytes()
        for n, row in enumerate(mesh.vertices.astype("<f8"))
    )
    rows = np.zeros(len(mesh.faces), [("length", "<f4"), ("corners", "<f8", 3)])
    rows["length"], rows["corners"] = 3, mesh.faces
    return Copy(head + vertices + rows.tobytes(), "ply", whole(mesh))


def ply_strips(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """Strips of triangles in one list, each ended by -1."""
    mesh = changed(mesh, rng)
    strips = [corner for a, b, c in mesh.faces.tolist() for corner in (a, b, c, -1)]
    head = ply_header(
        len(mesh.vertices), 1, form="binary_little_endian", vertex=("double x", "double y", "double z")
    )
    head = head.replace(b"element face", b"element tristrips").replace(b"uchar int", b"int int")
    body = mesh.vertices.astype("<f8").tobytes() + np.array([len(strips), *strips], "<i4").tobytes()
    return Copy(head + body, "ply", whole(mesh))


# OFF


def off_polygons(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """Colours of vertices and faces, comments, polygons."""
    mesh = changed(mesh, rng)
    polygons = merged(mesh)
    vertices = [[*row, 255, 0, 128, 255] for row in mesh.vertices.tolist()]
    rows = [[*row, 200, 100, 50] for row in counted(polygons)]
    head = f"COFF # colours\n# made by hand\n{len(vertices)} {len(rows)} 0\n\n"
    data = (head + lines(vertices) + "# faces\n" + lines(rows)).encode()
    return Copy(data, "off", whole(mesh), misread=fans(mesh, polygons))


def off_homogeneous(mesh: Mesh, rng: np.random.Generator) -> Copy:
    mesh = changed(mesh, rng)
    weights = rng.uniform(0.5, 2.0, (len(mesh.vertices), 1))
    vertices = np.hstack([weights * mesh.vertices, weights]).tolist()
    head = f"4OFF\n{len(vertices)} {len(mesh.faces)} 0\n"
    data = (head + lines(vertices) + lines(counted(mesh.faces.tolist()))).encode()
    return Copy(data, "off", whole(mesh), misread=(weights * mesh.vertices)[mesh.faces])


def off_wrapped(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """No line is a row."""
    mesh = changed(mesh, rng)
    numbers = [*mesh.vertices.ravel().tolist(), *np.insert(mesh.faces, 0, 3, axis=1).ravel().tolist()]
    rows = [numbers[start : start + 2] for start in range(0, len(numbers), 2)]
    return Copy(f"OFF {len(mesh.vertices)} {len(mesh.faces)} 0\n{lines(rows)}".encode(), "off", whole(mesh))


# OBJ


def obj_blocks(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """Pieces one after another, with negative indices, groups, materials, textures and normals."""
    mesh = changed(mesh, rng)
    text = "mtllib other.mtl\nvt 0 0\nvn 0 0 1\n"
    vertices, faces = [], []
    for n, piece in enumerate(split(mesh, rng, 200)):
        text += f"o object{n}\ng a b\nusemtl m{n % 3}\ns {n}\n" + lines(piece.vertices.tolist(), "v ")
        vertices.append(piece.vertices)
        faces.append(piece.faces - len(piece.vertices))
        text += lines([[f"{corner}/1/-1" for corner in face] for face in faces[-1].tolist()], "f ")
    misread = np.concatenate(vertices)[np.concatenate(faces)]
    return Copy(text.encode(), "obj", whole(mesh), misread=misread)


def obj_polygons(mesh: Mesh, rng: np.random.Generator, most: int) -> Copy:
    """Polygons in groups of one, after all vertices; long lines go on."""
    mesh = changed(mesh, rng)
    polygons = merged(mesh, most)
    rows = [" ".join(f"{corner + 1}//1" for corner in polygon) for polygon in polygons]
    text = lines([[*row, 0.5, 0.5, 0.5] for row in mesh.vertices.tolist()], "v ") + "vn 0 0 1\n"
    text += "".join(f"g face{n}\nf " + row.replace(" ", " \\\n", n % 2) + "\n" for n, row in enumerate(rows))
    return Copy(text.encode(), "obj", whole(mesh), misread=fans(mesh, polygons))
