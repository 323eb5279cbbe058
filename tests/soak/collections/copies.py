"""Changed copies of a mesh in what each format allows, each with the triangles that it means.

`KINDS` has the writers by name: of `core.io`, of trimesh, and small ones of this module. A writer takes a
mesh and random numbers, and moves, turns, scales and reorders the mesh first.
"""

import io
import itertools
import zipfile
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from core.arrays import Floats
from core.io import write_mesh
from core.mesh.mesh import Mesh, face_normals
from tests.core.io import threemf_files
from tests.core.io.files import counted, lines, ply_header
from tests.core.io.gltf_files import Gltf
from tests.core.shapes import as_trimesh, rotation

METRE, INCH = 1_000.0, 25.4
GLTF = ("glb", "gltf", "zip")
# Triangles of one plane that are merged at most, and the largest 1 - cosine between their normals.
_MOST, _COPLANAR = 8, 1e-9


class Copy(NamedTuple):
    """A file, the ending of its name, the triangles that it means, shape (f, 3, 3), and its unit in mm.

    `misread` are the triangles that trimesh takes from it, where these are others.
    """

    data: bytes
    ending: str
    triangles: Floats
    unit: float = 1.0
    misread: Floats | None = None


Writer = Callable[[Mesh, np.random.Generator], Copy]


def changed(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Return a mesh turned, scaled, moved by up to its size, with its vertices and faces in another order."""
    size = float(np.ptp(mesh.vertices, axis=0).max())
    turned = mesh.vertices @ rotation(rng.integers(1_000)).T
    moved = 10.0 ** rng.uniform(-1, 1) * (turned + size * rng.uniform(-1, 1, 3))
    order = rng.permutation(len(moved))
    numbers = np.empty_like(order)
    numbers[order] = np.arange(len(order))
    faces = numbers[mesh.faces[rng.permutation(len(mesh.faces))]]
    return Mesh(moved[order], np.roll(faces, rng.integers(3), axis=1))


def merged(mesh: Mesh, most: int = _MOST) -> list[list[int]]:
    """Return polygons that cover the mesh once: neighbours in one plane become one, of different corners."""
    corners = mesh.vertices[mesh.faces]
    normals, faces = face_normals(corners), mesh.faces.tolist()
    beside: dict[tuple[int, int], int] = {}
    for number, (a, b, c) in enumerate(faces):
        for edge in ((a, b), (b, c), (c, a)):
            # An edge of two faces in one direction joins none.
            beside[edge] = -1 if edge in beside else number
    free = normals.any(axis=1) & (np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1) > 0)
    polygons = []
    taken = np.zeros(len(faces), dtype=bool)
    for number in range(len(faces)):
        if taken[number]:
            continue
        taken[number] = True
        polygon, side = list(faces[number]), 0
        while free[number] and side < len(polygon) < most + 2:
            start, end = polygon[side], polygon[(side + 1) % len(polygon)]
            other = beside.get((end, start), -1)
            side += 1
            if (
                other < 0
                or taken[other]
                or not free[other]
                or 1 - normals[number] @ normals[other] > _COPLANAR
            ):
                continue
            apex = next(corner for corner in faces[other] if corner not in (start, end))
            if apex not in polygon:
                taken[other] = True
                polygon.insert(side, apex)
                side -= 1
        polygons.append(polygon)
    return polygons


def fans(mesh: Mesh, polygons: list[list[int]]) -> Floats:
    """Return the triangles between the first corner of each polygon and its sides, shape (f, 3, 3)."""
    return mesh.vertices[[[row[0], *side] for row in polygons for side in itertools.pairwise(row[1:])]]


def whole(mesh: Mesh) -> Floats:
    return mesh.vertices[mesh.faces]


def plain(mesh: Mesh, rng: np.random.Generator, write: Callable[[Mesh], bytes], ending: str) -> Copy:
    """Return a copy by a writer of meshes."""
    mesh = changed(mesh, rng)
    return Copy(write(mesh), ending, whole(mesh), METRE if ending in GLTF else 1.0)


def by_core(format: str) -> Writer:
    """Return the writer of `core.io`; its numbers are millimetres."""
    unit = METRE if format == "glb" else 1.0
    return lambda mesh, rng: plain(
        mesh, rng, lambda moved: write_mesh(Mesh(unit * moved.vertices, moved.faces), format), format
    )


def by_trimesh(format: str, ending: str = "", **options: Any) -> Writer:
    """Return the writer of trimesh; its numbers are the file's."""

    def write(mesh: Mesh) -> bytes:
        data = as_trimesh(mesh).export(file_type=format, **options)
        if isinstance(data, dict):
            return zipped(data)
        return data.encode() if isinstance(data, str) else data

    return lambda mesh, rng: plain(mesh, rng, write, ending or format)


def zipped(files: dict[str, bytes | str]) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return file.getvalue()


def split(mesh: Mesh, rng: np.random.Generator, most: int) -> Iterator[Mesh]:
    """Yield pieces of a mesh, each with vertices of its own."""
    for faces in np.array_split(mesh.faces, min(len(mesh.faces), rng.integers(1, most + 1))):
        used, corners = np.unique(faces, return_inverse=True)
        yield Mesh(mesh.vertices[used], corners.reshape(-1, 3))


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


# glTF


def local(vertices: Floats, matrix: Floats) -> Floats:
    """Return the vertices that a matrix of columns, shape (4, 4), maps to the given ones."""
    return np.linalg.solve(matrix, np.column_stack([vertices, np.ones(len(vertices))]).T)[:3].T


def placed(triangles: Floats, matrix: Floats) -> Floats:
    """Return triangles, shape (f, 3, 3), mapped by a matrix of columns; a mirror turns them over."""
    moved = triangles @ matrix[:3, :3].T + matrix[:3, 3]
    return moved[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else moved


def random_matrix(rng: np.random.Generator, size: float, *, mirror: bool) -> Floats:
    """Return a matrix of columns that turns, stretches, mirrors or not, and moves."""
    matrix = np.eye(4)
    stretch = rng.uniform(0.5, 2.0, 3) * (-1 if mirror else 1)
    matrix[:3, :3] = rotation(rng.integers(1_000)) * stretch
    matrix[:3, 3] = size * rng.uniform(-1, 1, 3)
    return matrix


def gltf_instances(mesh: Mesh, rng: np.random.Generator, *, embedded: bool) -> Copy:
    """Pieces placed by matrices and by translation, rotation and scale, below other nodes, twice each."""
    mesh, gltf, triangles = changed(mesh, rng), Gltf(), []
    size = float(np.ptp(mesh.vertices))
    for piece in split(mesh, rng, 5):
        number = gltf.mesh(piece.vertices, piece.faces)
        meant = piece.vertices.astype("<f4").astype(float)[piece.faces]
        for mirror in (False, True):
            above, turn = (
                random_matrix(rng, size, mirror=mirror),
                Rotation.from_matrix(rotation(rng.integers(99))),
            )
            scale, shift = rng.uniform(0.5, 2.0, 3), size * rng.uniform(-1, 1, 3)
            below = np.eye(4)
            below[:3, :3], below[:3, 3] = turn.as_matrix() * scale, shift
            child = gltf.node(
                mesh=number,
                rotation=turn.as_quat().tolist(),
                scale=scale.tolist(),
                translation=shift.tolist(),
            )
            gltf.node(children=[child], matrix=above.T.ravel().tolist())
            triangles.append(placed(meant, above @ below))
    return in_scene(gltf, np.concatenate(triangles), embedded=embedded)


def in_scene(gltf: Gltf, triangles: Floats, *, embedded: bool = False, misread: Floats | None = None) -> Copy:
    """Return the file, with the nodes that are no children in its scene."""
    children = {child for node in gltf.tree["nodes"] for child in node.get("children", ())}
    roots = [number for number in range(len(gltf.tree["nodes"])) if number not in children]
    gltf.tree |= {"scene": 0, "scenes": [{"nodes": roots}]}
    data, ending = (gltf.embedded(), "gltf") if embedded else (gltf.data(), "glb")
    return Copy(data, ending, triangles, METRE, misread)


def gltf_primitives(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """Triangles with indices of every size and without, in interleaved and shared arrays; points beside."""
    mesh, gltf, primitives = changed(mesh, rng), Gltf(), []
    points = mesh.vertices.astype("<f4")
    shared = gltf.accessor(points)
    for n, faces in enumerate(np.array_split(mesh.faces, min(len(mesh.faces), 4))):
        if n % 2:
            primitives.append({"attributes": {"POSITION": shared}, "indices": gltf.indices(faces)})
            continue
        corners = points[faces].reshape(-1, 3)
        # Positions beside normals.
        rows = np.hstack([corners, np.ones_like(corners)])
        view = gltf.view(rows, byteStride=24)
        accessor = gltf.accessor(corners, bufferView=view)
        small = "<u1" if len(corners) < 255 else "<u2" if len(corners) < 65_535 else "<u4"
        more = {"indices": gltf.indices(np.arange(len(corners)), small)} if n else {}
        primitives.append({"attributes": {"POSITION": accessor}, **more})
    primitives.append({"attributes": {"POSITION": shared}, "mode": 0})
    gltf.node(mesh=gltf.mesh_of(primitives))
    return in_scene(gltf, points[mesh.faces].astype(float))


def gltf_strips(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """One strip of all triangles, joined by ones without area."""
    mesh, gltf = changed(mesh, rng), Gltf()
    a, b, c = mesh.faces.T
    strip = np.column_stack([a, a, a, b, c, c])
    primitive = {
        "attributes": {"POSITION": gltf.accessor(mesh.vertices)},
        "indices": gltf.indices(strip),
        "mode": 5,
    }
    gltf.node(mesh=gltf.mesh_of([primitive]))
    return in_scene(gltf, whole(mesh))


def gltf_fans(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """Some hundred fans, with the triangles that a fan means, and the rest as triangles."""
    mesh, gltf = changed(mesh, rng), Gltf()
    shared = {"POSITION": gltf.accessor(mesh.vertices)}
    polygons = sorted(merged(mesh), key=len, reverse=True)
    first, rest = polygons[:200], [row[:3] for row in polygons[200:] if len(row) == 3]
    primitives = [{"attributes": shared, "indices": gltf.indices(row), "mode": 6} for row in first]
    if rest:
        primitives.append({"attributes": shared, "indices": gltf.indices(rest)})
    gltf.node(mesh=gltf.mesh_of(primitives))
    return in_scene(gltf, fans(mesh, first + rest), misread=mesh.vertices[rest] if rest else None)


def gltf_quantized(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """Positions in 16 bits (KHR_mesh_quantization), which a node stretches back."""
    mesh, gltf = changed(mesh, rng), Gltf()
    low, size = mesh.vertices.min(axis=0), float(np.ptp(mesh.vertices, axis=0).max())
    steps = np.rint(65_535 * (mesh.vertices - low) / size).astype("<u2")
    # Rows of three numbers of two bytes begin at multiples of four.
    rows = np.pad(steps, ((0, 0), (0, 1)))
    accessor = gltf.accessor(steps, "<u2", bufferView=gltf.view(rows, byteStride=8), normalized=True)
    primitive = {"attributes": {"POSITION": accessor}, "indices": gltf.indices(mesh.faces)}
    gltf.node(mesh=gltf.mesh_of([primitive]), scale=[size] * 3, translation=low.tolist())
    used = ["KHR_mesh_quantization"]
    gltf.tree |= {"extensionsUsed": used, "extensionsRequired": used}
    meant, misread = (steps / 65_535 * size + low)[mesh.faces], (steps * size + low)[mesh.faces]
    return in_scene(gltf, meant, misread=misread)


def gltf_sparse(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """Every third position is a sparse one."""
    mesh, gltf = changed(mesh, rng), Gltf()
    base, third = mesh.vertices.copy(), np.arange(0, len(mesh.vertices), 3)
    base[third] = 0.0
    sparse = {
        "count": len(third),
        "indices": {"bufferView": gltf.view(third.astype("<u4")), "componentType": 5125},
        "values": {"bufferView": gltf.view(mesh.vertices[third].astype("<f4"))},
    }
    primitive = {
        "attributes": {"POSITION": gltf.accessor(base, sparse=sparse)},
        "indices": gltf.indices(mesh.faces),
    }
    gltf.node(mesh=gltf.mesh_of([primitive]))
    return in_scene(gltf, whole(mesh), misread=base[mesh.faces])


def gltf_posed(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """A skin at rest, and a morph target with its default weight."""
    mesh, gltf = changed(mesh, rng), Gltf()
    count, size = len(mesh.vertices), float(np.ptp(mesh.vertices))
    matrix = random_matrix(rng, size, mirror=False)
    change = rng.normal(size=(count, 3)) * size / 100
    target = {"POSITION": gltf.accessor(change)}
    number = gltf.mesh(
        mesh.vertices - 0.5 * change,
        mesh.faces,
        attributes=gltf.bound([0, 0, 0, 0], [1, 0, 0, 0], count),
        primitive={"targets": [target]},
        weights=[0.5],
    )
    joint = gltf.node(matrix=matrix.T.ravel().tolist())
    gltf.tree["skins"] = [{"joints": [joint]}]
    gltf.node(mesh=number, skin=0)
    return in_scene(gltf, placed(whole(mesh), matrix), misread=(mesh.vertices - 0.5 * change)[mesh.faces])


def gltf_copies(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """Three copies of one node (EXT_mesh_gpu_instancing)."""
    mesh, gltf = changed(mesh, rng), Gltf()
    shifts = float(np.ptp(mesh.vertices)) * rng.uniform(-2, 2, (3, 3)).astype("<f4").astype(float)
    attributes = {"TRANSLATION": gltf.accessor(shifts)}
    gltf.node(
        mesh=gltf.mesh(mesh.vertices, mesh.faces),
        extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}},
    )
    gltf.tree["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    return in_scene(gltf, np.concatenate([whole(mesh) + shift for shift in shifts]), misread=whole(mesh))


# 3MF


def threemf_assembly(mesh: Mesh, rng: np.random.Generator) -> Copy:
    """Inches: objects placed in an assembly, also mirrored, and the assembly twice; support beside."""
    mesh, objects, inside, triangles = changed(mesh, rng), "", [], []
    size = float(np.ptp(mesh.vertices))
    for number, piece in enumerate(split(mesh, rng, 5), start=1):
        objects += threemf_files.thing(
            number, threemf_files.mesh(piece.vertices.tolist(), piece.faces.tolist())
        )
        for mirror in (False, True):
            matrix = random_matrix(rng, size, mirror=mirror)
            inside.append((number, twelve(matrix)))
            triangles.append(placed(whole(piece), matrix))
    objects += threemf_files.thing(90, threemf_files.components(*inside))
    objects += threemf_files.thing(91, type="support")
    places = [random_matrix(rng, size, mirror=mirror) for mirror in (False, True)]
    items = [*((90, twelve(matrix)) for matrix in places), (91, None)]
    text = threemf_files.model(objects, items, head='unit="inch"')
    assembly = np.concatenate(triangles)
    meant = np.concatenate([placed(assembly, matrix) for matrix in places])
    return Copy(threemf_files.package(text), "3mf", meant, INCH)


def twelve(matrix: Floats) -> str:
    """Return the transform of a 3MF, by rows, of a matrix of columns."""
    return " ".join(repr(float(value)) for value in matrix[:3].T.ravel())


KINDS: dict[str, Writer] = {
    "STL by core.io": by_core("stl"),
    "STL by trimesh": by_trimesh("stl"),
    "STL text by trimesh": by_trimesh("stl_ascii", "stl"),
    "STL text of many solids": stl_text,
    "STL with attributes": stl_binary,
    "PLY by core.io": by_core("ply"),
    "PLY by trimesh": by_trimesh("ply"),
    "PLY text by trimesh": by_trimesh("ply", encoding="ascii"),
    "PLY big-endian of polygons": ply_big_endian,
    "PLY text of polygons": partial(ply_text, lists=False),
    "PLY text with lists at vertices": partial(ply_text, lists=True),
    "PLY with lists and floats": ply_lists,
    "PLY of strips": ply_strips,
    "OFF by core.io": by_core("off"),
    "OFF by trimesh": by_trimesh("off"),
    "OFF of coloured polygons": off_polygons,
    "OFF with homogeneous coordinates": off_homogeneous,
    "OFF wrapped": off_wrapped,
    "OBJ by core.io": by_core("obj"),
    "OBJ by trimesh": by_trimesh("obj"),
    "OBJ of groups, counted back": obj_blocks,
    "OBJ of quadrilaterals": partial(obj_polygons, most=2),
    "OBJ of polygons, a group each": partial(obj_polygons, most=_MOST),
    "GLB by core.io": by_core("glb"),
    "GLB by trimesh": by_trimesh("glb"),
    "GLB of instances": partial(gltf_instances, embedded=False),
    "glTF of instances, embedded": partial(gltf_instances, embedded=True),
    "glTF by trimesh, in a ZIP": by_trimesh("gltf", "zip"),
    "GLB of many primitives": gltf_primitives,
    "GLB of strips": gltf_strips,
    "GLB of fans": gltf_fans,
    "GLB quantized": gltf_quantized,
    "GLB sparse": gltf_sparse,
    "GLB with skin and morph target": gltf_posed,
    "GLB of GPU instances": gltf_copies,
    "3MF by core.io": by_core("3mf"),
    "3MF of an assembly in inches": threemf_assembly,
}
