"""The instances of meshes in a glTF scene, with their transforms."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from core.arrays import Floats
from core.errors import MalformedMeshError
from core.io.checks import Limits, within
from core.io.gltf_document import Document, Entry

_NODES_PER_PART = 16


class Instance(NamedTuple):
    """An instance of a mesh in the scene.

    Attributes
    ----------
    mesh : int
        Index of the mesh.
    matrix : float64, shape (4, 4)
        Maps columns (x, y, z, 1) to the scene.
    node : int
        Index of the node that places the mesh.
    """

    mesh: int
    matrix: Floats
    node: int


def place(document: Document, limits: Limits) -> list[Instance]:
    """Return the instances of meshes in the scene.

    The mesh of a skinned node is at the origin: the transform of the node does not apply to it (glTF 2.0,
    section 3.7.3.3), and its joints are at rest.

    Raises
    ------
    MalformedMeshError
        The nodes do not form trees.
    MeshTooComplexError
        There are more than 16 nodes for each part of the limit.
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


def parents(document: Document) -> dict[int, int]:
    """Return the parent of each node that has one, by their indices."""
    return {
        child: number
        for number, node in enumerate(document.sections["nodes"])
        for child in _references(node, "children")
    }


def _roots(document: Document) -> list[int]:
    """Return the root nodes of the scene, or of all nodes if there is no scene."""
    if document.sections["scenes"]:
        return _references(document.entry("scenes", document.scene), "nodes")
    nodes = document.sections["nodes"]
    children = {child for node in nodes for child in _references(node, "children")}
    return [number for number in range(len(nodes)) if number not in children]


def _references(entry: Entry, name: str) -> list[int]:
    """Return a list of node indices; an empty list if it is absent."""
    found = entry.get(name, [])
    if not isinstance(found, list) or not all(type(number) is int for number in found):
        raise MalformedMeshError(f"the {name} in the JSON of the GLB are not a list of numbers")
    return found


def _local(node: Entry) -> Floats:
    """Return the transform from a node to its parent: its matrix, or translation * rotation * scale."""
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
