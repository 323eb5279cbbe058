"""Reading GLB, the binary form of glTF 2.0: the scene, its meshes and their instances; writing GLB."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError, NoTrianglesError
from core.io.checks import Limits, check_indices, joined, within
from core.io.gltf_document import (
    Document,
    Entry,
    count_elements,
    entries,
    read_document,
    read_indices,
    read_positions,
    whole,
)
from core.io.parts import PATH_NAMES, Part, clean_name, distinct, mesh_digest
from core.io.trimesh_export import export
from core.mesh.mesh import Mesh

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_NODES_PER_PART = 16
# A transform nearer to the identity than this leaves the positions as they are.
_ROUNDING = 1e-8


class Instance(NamedTuple):
    """An instance of a mesh in the scene: the indices of the mesh and of the node that places it.

    The matrix, shape (4, 4), maps columns (x, y, z, 1) to the scene.
    """

    mesh: int
    matrix: Floats
    node: int


@dataclass(frozen=True)
class Scene:
    """The triangles of a checked GLB.

    `meshes` are those with triangles, by index: vertices, shape (n, 3), and faces, shape (f, 3). `instances`
    are theirs.
    """

    document: Document
    instances: list[Instance]
    meshes: dict[int, tuple[Floats, Ints]]


def read(data: bytes, limits: Limits) -> tuple[Floats, Ints]:
    """Return the vertices, shape (n, 3), and faces, shape (f, 3), of all instances of the scene's meshes."""
    scene = read_scene(data, limits)
    # The last instance first: vertices have the numbers that trimesh gives them.
    instances = reversed(scene.instances)
    return joined(_transformed(*scene.meshes[instance.mesh], instance.matrix) for instance in instances)


def write(mesh: Mesh) -> bytes:
    """Return a mesh as a GLB of one node."""
    return export(mesh, "glb")


def read_parts(data: bytes, limits: Limits) -> list[Part]:
    """Return the distinct meshes of a GLB, each in its own frame, in the order of their first instances.

    Meshes with the same name, vertices and faces are one part.
    """
    scene = read_scene(data, limits)
    parents = {
        child: number
        for number, node in enumerate(scene.document.sections["nodes"])
        for child in _references(node, "children")
    }
    document, meshes = scene.document, scene.meshes
    names = {number: clean_name(document.entry("meshes", number).get("name")) for number in meshes}
    keys = {number: (names[number], mesh_digest(*mesh)) for number, mesh in meshes.items()}
    return [
        Part(names[part.mesh], _path(document, parents, part.node), times, Mesh(*meshes[part.mesh]))
        for part, times in distinct(((keys[part.mesh], part) for part in scene.instances), limits)
    ]


def read_scene(data: bytes, limits: Limits) -> Scene:
    """Read the meshes of the scene and their instances.

    Skins, morph targets, cameras, materials and images are left out; no image is decoded.
    """
    document = read_document(data)
    instances = _place(document, limits)
    counts = Counter(instance.mesh for instance in instances)
    # Everything is counted before any mesh is decoded: instances of primitives, triangles, then vertices.
    primitives = {number: list(_primitives(document.entry("meshes", number))) for number in counts}
    within(
        sum(len(primitives[n]) * times for n, times in counts.items()), limits.parts, "instances of meshes"
    )
    triangles = {
        number: sum(_count_triangles(document, primitive, mode) for primitive, mode in primitives[number])
        for number in counts
    }
    within(sum(triangles[number] * times for number, times in counts.items()), limits.faces, "triangles")
    meshes = {
        number: joined(_read_triangles(document, primitive, mode) for primitive, mode in primitives[number])
        for number in counts
        if triangles[number]
    }
    if not meshes:
        raise NoTrianglesError("the scene of the GLB has no triangles")
    within(sum(len(meshes[number][0]) * counts[number] for number in meshes), limits.vertices, "vertices")
    return Scene(document, [instance for instance in instances if instance.mesh in meshes], meshes)


def _transformed(vertices: Floats, faces: Ints, matrix: Floats) -> tuple[Floats, Ints]:
    """Return an instance of a mesh; a transform that mirrors reverses the faces, so they stay outwards."""
    if np.ptp(matrix - np.eye(4)) < _ROUNDING:
        return vertices, faces
    columns = np.column_stack([vertices, np.ones(len(vertices))]).T
    mirrored = np.linalg.det(matrix[:3, :3]) < 0
    return (matrix @ columns)[:3].T, faces[:, ::-1] if mirrored else faces


def _place(document: Document, limits: Limits) -> list[Instance]:
    """Return the instances of meshes in the scene, from the roots to the leaves.

    The mesh of a skinned node is at the origin: the transform of the node does not apply to it (glTF 2.0,
    section 3.7.3.3), and its joints are at rest. Raise MalformedMeshError if the nodes do not form trees, and
    MeshTooComplexError for more than 16 nodes for each part of the limit.
    """
    within(len(document.sections["nodes"]), _NODES_PER_PART * limits.parts, "nodes")
    instances: list[Instance] = []
    visited: set[int] = set()
    waiting = [(root, np.eye(4)) for root in reversed(_roots(document))]
    while waiting:
        number, parent = waiting.pop()
        node = document.entry("nodes", number)
        if number in visited:
            raise MalformedMeshError("a node of the GLB is reached twice")
        visited.add(number)
        matrix = parent @ _local(node)
        if "mesh" in node:
            document.entry("meshes", node["mesh"])
            instances.append(Instance(node["mesh"], np.eye(4) if "skin" in node else matrix, number))
        waiting += [(child, matrix) for child in reversed(_references(node, "children"))]
    return instances


def _roots(document: Document) -> list[int]:
    """Return the root nodes of the scene, or of all nodes if there is no scene."""
    if document.sections["scenes"]:
        return _references(document.entry("scenes", document.scene), "nodes")
    nodes = document.sections["nodes"]
    children = {child for node in nodes for child in _references(node, "children")}
    return [number for number in range(len(nodes)) if number not in children]


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
    count = count_elements(document, positions if indices is None else indices)
    if mode == _TRIANGLES and count % 3:
        raise MalformedMeshError(
            f"a primitive of the GLB has {count} corners, which do not make whole triangles"
        )
    return count // 3 if mode == _TRIANGLES else max(count - 2, 0)


def _read_triangles(document: Document, primitive: Entry, mode: int) -> tuple[Floats, Ints]:
    """Return the positions that a primitive uses, shape (n, 3), and its faces, shape (f, 3).

    Primitives often share an array and use a part of it each. The number of triangles is already checked.
    """
    indices, positions = _source(primitive)
    count = count_elements(document, positions)
    corners = np.arange(count) if indices is None else read_indices(document, indices)
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
    return read_positions(document, positions, used), faces


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
    while node is not None and len(names) < PATH_NAMES:
        entry = document.entry("nodes", node)
        name = clean_name(entry.get("name"))
        if not name and "mesh" in entry:
            name = clean_name(document.entry("meshes", entry["mesh"]).get("name"))
        names.append(name)
        node = parents.get(node)
    return tuple(reversed(names))
