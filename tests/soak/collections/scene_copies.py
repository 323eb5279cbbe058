"""Copies in glTF and 3MF: instances, transforms, primitives of every kind, extensions, assemblies."""

import numpy as np
from scipy.spatial.transform import Rotation

from core.arrays import Floats
from core.mesh.mesh import Mesh
from tests.core.io import threemf_files
from tests.core.io.gltf_files import Gltf
from tests.core.shapes import rotation
from tests.soak.collections.copies import METRE, Copy, changed, fans, merged, split, whole

INCH = 25.4


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
