"""Reading glTF 2.0: the scene, its meshes, deformed by weights and skins, their instances; writing GLB."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError, NoTrianglesError
from core.io.checks import Content, Limits, check_indices, joined, within
from core.io.gltf_document import (
    Document,
    Entry,
    compressed,
    count_elements,
    entries,
    read_document,
    read_integers,
    read_vectors,
    whole,
)
from core.io.parts import PATH_NAMES, Part, clean_name, distinct, mesh_digest
from core.io.trimesh_export import export
from core.mesh.mesh import Mesh

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_NODES_PER_PART = 16
MILLIMETRES = 1_000.0
"""Millimetres in a metre, the unit of glTF."""
# Vertices of a skin taken at a time.
_BLOCK = 65_536
_INSTANCING, _VISIBILITY, _DRACO = (
    "EXT_mesh_gpu_instancing",
    "KHR_node_visibility",
    "KHR_draco_mesh_compression",
)
# A transform nearer to the identity than this leaves the positions as they are.
_ROUNDING = 1e-8


class Geometry(NamedTuple):
    """A mesh as a node shows it: its index, its morph weights, and the node if it is skinned, or -1."""

    mesh: int
    weights: tuple[float, ...] = ()
    skinned: int = -1


class Instance(NamedTuple):
    """An instance of a mesh in the scene, and the index of the node that places it.

    The matrix, shape (4, 4), maps columns (x, y, z, 1) to the scene.
    """

    geometry: Geometry
    matrix: Floats
    node: int


@dataclass(frozen=True)
class Scene:
    """The triangles of a checked GLB.

    `meshes` are those with triangles, as they are shown: vertices, shape (n, 3), and faces, shape (f, 3), in
    metres. `instances` are theirs.
    """

    document: Document
    instances: list[Instance]
    meshes: dict[Geometry, tuple[Floats, Ints]]


def read(data: bytes, limits: Limits) -> Content:
    """Return the vertices and faces of all instances of the scene's meshes, in millimetres."""
    scene = read_scene(data, limits)
    # The last instance first: vertices have the numbers that trimesh gives them.
    instances = reversed(scene.instances)
    vertices, faces = joined(
        _transformed(*scene.meshes[instance.geometry], instance.matrix) for instance in instances
    )
    return Content(vertices * MILLIMETRES, faces)


def write(mesh: Mesh) -> bytes:
    """Return a mesh in millimetres as a GLB of one node."""
    return export(Mesh(mesh.vertices / MILLIMETRES, mesh.faces), "glb")


def read_parts(data: bytes, limits: Limits) -> list[Part]:
    """Return the distinct meshes, each in its own frame, in millimetres, in the order of first instances.

    Meshes with the same name, vertices and faces are one part.
    """
    scene = read_scene(data, limits)
    parents = {
        child: number
        for number, node in enumerate(scene.document.sections["nodes"])
        for child in _references(node, "children")
    }
    document, meshes = scene.document, scene.meshes
    names = {shape: clean_name(document.entry("meshes", shape.mesh).get("name")) for shape in meshes}
    keys = {shape: (names[shape], mesh_digest(*mesh)) for shape, mesh in meshes.items()}
    parts = distinct(((keys[part.geometry], part) for part in scene.instances), limits)
    return [
        Part(
            names[part.geometry],
            _path(document, parents, part.node),
            times,
            Mesh(meshes[part.geometry][0] * MILLIMETRES, meshes[part.geometry][1]),
        )
        for part, times in parts
    ]


def read_scene(data: bytes, limits: Limits) -> Scene:
    """Read the meshes of the scene and their instances.

    Meshes are in the pose that is shown first: with their default morph weights, and bound to the joints of
    their skins as these are placed. Animations, cameras, materials and images are left out; no image is
    decoded.
    """
    document = read_document(data, limits)
    instances, matrices = _place(document, limits)
    counts = Counter(instance.geometry for instance in instances)
    # Everything is counted before any mesh is decoded: instances of primitives, triangles, then vertices.
    primitives = {n: list(_primitives(document.entry("meshes", n))) for n in {shape.mesh for shape in counts}}
    placed = sum(len(primitives[shape.mesh]) * times for shape, times in counts.items())
    within(placed, limits.parts, "instances of meshes")
    triangles = {
        n: sum(_count_triangles(document, primitive, mode) for primitive, mode in primitives[n])
        for n in primitives
    }
    within(sum(triangles[shape.mesh] * times for shape, times in counts.items()), limits.faces, "triangles")
    meshes: dict[Geometry, tuple[Floats, Ints]] = {}
    for shape in counts:
        if triangles[shape.mesh]:
            skin = _skin(document, shape.skinned, matrices) if shape.skinned >= 0 else None
            meshes[shape] = joined(
                _read_triangles(document, primitive, mode, shape.weights, skin)
                for primitive, mode in primitives[shape.mesh]
            )
    if not meshes:
        raise NoTrianglesError("the scene of the GLB has no triangles")
    within(sum(len(meshes[shape][0]) * counts[shape] for shape in meshes), limits.vertices, "vertices")
    return Scene(document, [instance for instance in instances if instance.geometry in meshes], meshes)


def _transformed(vertices: Floats, faces: Ints, matrix: Floats) -> tuple[Floats, Ints]:
    """Return an instance of a mesh; a transform that mirrors reverses the faces, so they stay outwards."""
    if np.ptp(matrix - np.eye(4)) < _ROUNDING:
        return vertices, faces
    columns = np.column_stack([vertices, np.ones(len(vertices))]).T
    mirrored = np.linalg.det(matrix[:3, :3]) < 0
    return (matrix @ columns)[:3].T, faces[:, ::-1] if mirrored else faces


def _place(document: Document, limits: Limits) -> tuple[list[Instance], dict[int, Floats]]:
    """Return the instances of meshes in the scene, from roots to leaves, and the matrices of all nodes.

    The mesh of a skinned node is at the origin: the transform of the node does not apply to it (glTF 2.0,
    section 3.7.3.3). Raise MalformedMeshError if the nodes do not form trees, and MeshTooComplexError for
    more than 16 nodes or instances for each part of the limit.
    """
    nodes = document.sections["nodes"]
    within(len(nodes), _NODES_PER_PART * limits.parts, "nodes")
    if not nodes and not document.sections["scenes"]:
        # Without nodes and scenes, every mesh is where it is.
        return [Instance(Geometry(n), np.eye(4), -1) for n in range(len(document.sections["meshes"]))], {}
    instances: list[Instance] = []
    matrices: dict[int, Floats] = {}
    scene = _roots(document)
    roots = dict.fromkeys(scene, True)
    if len(roots) < len(scene):
        raise MalformedMeshError("a node of the GLB is reached twice")
    if document.sections["skins"]:
        # Joints may be outside the scene.
        roots |= {root: False for root in _parentless(document) if root not in roots}
    waiting = [(root, np.eye(4), in_scene) for root, in_scene in reversed(roots.items())]
    while waiting:
        number, parent, shown = waiting.pop()
        node = document.entry("nodes", number)
        if number in matrices and not shown:
            continue
        if number in matrices:
            raise MalformedMeshError("a node of the GLB is reached twice")
        matrices[number] = matrix = parent @ _local(node)
        extensions = _objects(node, "extensions")
        shown = shown and _objects(extensions, _VISIBILITY).get("visible") is not False
        if "mesh" in node and shown:
            mesh = document.entry("meshes", node["mesh"])
            weights = node.get("weights", mesh.get("weights", []))
            weights = tuple(_numbers(weights, len(weights) if isinstance(weights, list) else 0))
            if "skin" in node:
                instances.append(Instance(Geometry(node["mesh"], weights, number), np.eye(4), number))
            else:
                shape = Geometry(node["mesh"], weights)
                copies = _copies(document, _objects(extensions, _INSTANCING), limits)
                instances += [Instance(shape, matrix @ copy, number) for copy in copies]
            within(len(instances), _NODES_PER_PART * limits.parts, "instances of meshes")
        waiting += [(child, matrix, shown) for child in reversed(_references(node, "children"))]
    return instances, matrices


def _copies(document: Document, instancing: Entry, limits: Limits) -> list[Floats]:
    """Return the transforms of the copies of a node (EXT_mesh_gpu_instancing), shape (4, 4) each."""
    attributes = _objects(instancing, "attributes")
    tables: dict[str, Floats] = {}
    for name, kind in (("translation", "VEC3"), ("rotation", "VEC4"), ("scale", "VEC3")):
        if name.upper() in attributes:
            within(count_elements(document, attributes[name.upper()]), limits.parts, "instances of meshes")
            tables[name] = read_vectors(document, attributes[name.upper()], kind)
    if not tables:
        return [np.eye(4)]
    rows = zip(*(table.tolist() for table in tables.values()), strict=True)
    return [_local(dict(zip(tables, row, strict=True))) for row in rows]


def _skin(document: Document, number: int, matrices: dict[int, Floats]) -> Floats:
    """Return the transforms of the joints of a node, from the mesh to the scene, shape (j, 4, 4)."""
    skin = document.entry("skins", document.entry("nodes", number)["skin"])
    joints = _references(skin, "joints")
    if not joints or not set(joints) <= set(matrices):
        raise MalformedMeshError("a skin of the GLB has no joints, or refers to one that is not there")
    transforms = np.stack([matrices[joint] for joint in joints])
    if "inverseBindMatrices" in skin:
        inverses = read_vectors(document, skin["inverseBindMatrices"], "MAT4")
        if len(inverses) < len(joints):
            raise MalformedMeshError("a skin of the GLB has fewer matrices than joints")
        # glTF stores matrices by columns.
        transforms = transforms @ inverses[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
    return transforms


def _skinned(
    document: Document, attributes: Entry, skin: Floats, used: Ints, positions: Floats
) -> tuple[Floats, bool]:
    """Return the positions of skinned vertices, shape (n, 3), and whether the skin mirrors them.

    A vertex goes to the weighted sum of the transforms of its joints (glTF 2.0, section 3.7.3). Weights are
    scaled to a sum of 1.
    """
    sets = [n for n in range(len(attributes)) if f"JOINTS_{n}" in attributes and f"WEIGHTS_{n}" in attributes]
    if not sets:
        return positions, False
    joints = np.hstack([read_integers(document, attributes[f"JOINTS_{n}"], "VEC4", used) for n in sets])
    weights = np.hstack([read_vectors(document, attributes[f"WEIGHTS_{n}"], "VEC4", used) for n in sets])
    check_indices(joints, len(skin))
    sums = weights.sum(axis=1, keepdims=True)
    weights = np.where(sums > 0, weights / np.where(sums > 0, sums, 1.0), np.eye(weights.shape[1])[0])
    moved = np.empty_like(positions)
    volume = 0.0
    for start in range(0, len(positions), _BLOCK):
        rows = slice(start, start + _BLOCK)
        transforms = (weights[rows, :, None, None] * skin[joints[rows], :3]).sum(axis=1)
        moved[rows] = (transforms[:, :, :3] @ positions[rows, :, None])[..., 0] + transforms[:, :, 3]
        volume += float(np.linalg.det(transforms[:, :, :3]).sum())
    return moved, volume < 0


def _roots(document: Document) -> list[int]:
    """Return the root nodes of the scene, or of all nodes if there is no scene."""
    if document.sections["scenes"]:
        return _references(document.entry("scenes", document.scene), "nodes")
    return _parentless(document)


def _parentless(document: Document) -> list[int]:
    """Return the nodes that are no child of another."""
    nodes = document.sections["nodes"]
    children = {child for node in nodes for child in _references(node, "children")}
    return [number for number in range(len(nodes)) if number not in children]


def _objects(parent: Entry, name: str) -> Entry:
    """Return an object of an object; an empty one if it is absent."""
    value = parent.get(name, {})
    if not isinstance(value, dict):
        raise MalformedMeshError(f"the {name} in the JSON of the GLB are not an object")
    return value


def _references(entry: Entry, name: str) -> list[int]:
    """Return a list of node indices; an empty list if it is absent."""
    numbers = entry.get(name, [])
    if not isinstance(numbers, list) or not all(type(number) is int for number in numbers):
        raise MalformedMeshError(f"the {name} in the JSON of the GLB are not a list of numbers")
    return numbers


def _local(node: Entry) -> Floats:
    """Return the transform from a node to its parent: its matrix, or translation * rotation * scale."""
    # Few files rotate nodes, and the import of the transforms takes a third of a second.
    from scipy.spatial.transform import Rotation  # noqa: PLC0415

    if "matrix" in node:
        return _numbers(node["matrix"], 16).reshape(4, 4).T
    matrix = np.eye(4)
    if "rotation" in node:
        matrix[:3, :3] = Rotation.from_quat(_numbers(node["rotation"], 4)).as_matrix()
    if "scale" in node:
        matrix[:3, :3] *= _numbers(node["scale"], 3)
    if "translation" in node:
        matrix[:3, 3] = _numbers(node["translation"], 3)
    return matrix


def _numbers(values: object, size: int) -> Floats:
    """Return the numbers of a transform, shape (size,)."""
    if (
        not isinstance(values, list)
        or len(values) != size
        or not all(type(v) in (int, float) for v in values)
    ):
        raise MalformedMeshError("a transform in the GLB is not made of the numbers it should be")
    return np.array(values, dtype=np.float64)


def _primitives(mesh: Entry) -> Iterator[tuple[Entry, int]]:
    """Yield the primitives of triangles with their mode; points and lines are left out."""
    for primitive in entries(mesh, "primitives"):
        mode = whole(primitive, "mode", _TRIANGLES)
        if mode in {_TRIANGLES, _STRIP, _FAN}:
            yield primitive, mode


def _source(primitive: Entry) -> tuple[object, object]:
    """Return the accessor indices of the indices (None if absent) and of the positions."""
    attributes = primitive.get("attributes")
    if not isinstance(attributes, dict) or "POSITION" not in attributes:
        raise MalformedMeshError("a primitive of the GLB has no positions")
    return primitive.get("indices"), attributes["POSITION"]


def _count_triangles(document: Document, primitive: Entry, mode: int) -> int:
    """Return the number of triangles of a primitive without reading them."""
    indices, positions = _source(primitive)
    if _DRACO in _objects(primitive, "extensions") and "bufferView" not in document.entry(
        "accessors", positions
    ):
        raise compressed(_DRACO)
    count = count_elements(document, positions if indices is None else indices)
    if mode == _TRIANGLES and count % 3:
        raise MalformedMeshError(
            f"a primitive of the GLB has {count} corners, which do not make whole triangles"
        )
    return count // 3 if mode == _TRIANGLES else max(count - 2, 0)


def _read_triangles(
    document: Document, primitive: Entry, mode: int, weights: Sequence[float], skin: Floats | None
) -> tuple[Floats, Ints]:
    """Return the positions that a primitive uses, shape (n, 3), and its faces, shape (f, 3).

    Primitives often share an array and use a part of it each. The number of triangles is already checked.
    """
    indices, source = _source(primitive)
    count = count_elements(document, source)
    corners = np.arange(count) if indices is None else read_integers(document, indices).ravel()
    check_indices(corners, count)
    if mode == _TRIANGLES:
        faces = corners.reshape(-1, 3)
    elif mode == _FAN:
        faces = np.column_stack([np.broadcast_to(corners[:1], len(corners[2:])), corners[1:-1], corners[2:]])
    else:
        faces = np.column_stack([corners[:-2], corners[1:-1], corners[2:]])
        # Every second triangle of a strip has the opposite orientation.
        faces[1::2] = faces[1::2, ::-1]
    used, faces = _used(count, faces)
    positions = read_vectors(document, source, "VEC3", used)
    # Morph targets hold displacements.
    for weight, target in zip(weights, entries(primitive, "targets"), strict=False):
        if weight and "POSITION" in target:
            if count_elements(document, target["POSITION"]) != count:
                raise MalformedMeshError(
                    "a morph target of the GLB has another number of vertices than its mesh"
                )
            positions += weight * read_vectors(document, target["POSITION"], "VEC3", used)
    if skin is not None:
        for name in primitive["attributes"]:
            if name.startswith(("JOINTS_", "WEIGHTS_")):
                check_indices(used, count_elements(document, primitive["attributes"][name]))
        positions, mirrored = _skinned(document, primitive["attributes"], skin, used, positions)
        faces = faces[:, ::-1] if mirrored else faces
    return positions, faces


def _used(count: int, faces: Ints) -> tuple[Ints, Ints]:
    """Return the vertices, of `count`, that faces use, in ascending order, and the faces in their numbers."""
    if count > faces.size:
        # Many primitives may share one array: a pass over it for each would take unbounded time.
        used, numbers = np.unique(faces, return_inverse=True)
        return used, numbers.reshape(-1, 3)
    mask = np.zeros(count, dtype=bool)
    mask[faces] = True
    return np.flatnonzero(mask), (np.cumsum(mask) - 1)[faces]


def _path(document: Document, parents: dict[int, int], node: int | None) -> tuple[str, ...]:
    """Return the names from the root to a node; a node without a name has that of its mesh."""
    names: list[str] = []
    while node is not None and node >= 0 and len(names) < PATH_NAMES:
        entry = document.entry("nodes", node)
        name = clean_name(entry.get("name"))
        if not name and "mesh" in entry:
            name = clean_name(document.entry("meshes", entry["mesh"]).get("name"))
        names.append(name)
        node = parents.get(node)
    return tuple(reversed(names))
