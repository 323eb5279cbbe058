"""Reading GLB, the binary form of glTF 2.0."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError, NoTrianglesError
from core.io.checks import Limits, within
from core.io.gltf_document import Document, read_document
from core.io.gltf_primitive import count_triangles, primitives, read_triangles
from core.io.gltf_scene import Instance, place
from core.io.gltf_write import plain_glb
from core.io.trimesh_adapter import load_glb


@dataclass(frozen=True)
class Scene:
    """The triangles of a checked GLB.

    Attributes
    ----------
    document : Document
    instances : list of Instance
    meshes : dict of int to (vertices, faces)
        The meshes with triangles, by index: vertices float64, shape (n, 3), and faces int64, shape (f, 3).
    """

    document: Document
    instances: list[Instance]
    meshes: dict[int, tuple[Floats, Ints]]


def read(data: bytes, limits: Limits) -> tuple[Floats, Ints]:
    """Return the vertices, shape (n, 3), and the faces, shape (f, 3), of all instances of the scene's meshes.

    trimesh reads a GLB with only the meshes of the scene and their transforms.

    Raises
    ------
    MeshError
        The file is malformed or exceeds the limits; the subclass tells the kind of fault.
    """
    scene = read_scene(data, limits)
    placed = [scene.meshes[one.mesh] for one in scene.instances if one.mesh in scene.meshes]
    expected = [sum(len(mesh[part]) for mesh in placed) for part in (0, 1)]
    vertices, faces = load_glb(plain_glb(scene.instances, scene.meshes))
    if [len(vertices), len(faces)] != expected:
        raise MalformedMeshError(
            f"the GLB declares {expected[0]} vertices and {expected[1]} triangles, "
            f"but {len(vertices)} and {len(faces)} can be read"
        )
    return vertices, faces


def read_scene(data: bytes, limits: Limits) -> Scene:
    """Read the meshes of the scene and their instances.

    Skins, morph targets, cameras, materials and images are left out; no image is decoded.

    Raises
    ------
    MeshError
        The file is malformed or exceeds the limits; the subclass tells the kind of fault.
    """
    document = read_document(data)
    placed = place(document, limits)
    instances = Counter(one.mesh for one in placed)
    within(_parts(document, instances), limits.parts, "instances of meshes")
    declared = {number: _declared(document, number) for number in instances}
    within(sum(declared[number] * times for number, times in instances.items()), limits.faces, "triangles")
    meshes = {number: _mesh(document, number) for number in instances if declared[number]}
    if not meshes:
        raise NoTrianglesError("the scene of the GLB has no triangles")
    vertices = sum(len(meshes[number][0]) * instances[number] for number in meshes)
    within(vertices, limits.vertices, "vertices")
    return Scene(document, placed, meshes)


def _parts(document: Document, instances: Counter[int]) -> int:
    """Return the number of instances of primitives in the scene."""
    return sum(
        sum(1 for _ in primitives(document.entry("meshes", n))) * times for n, times in instances.items()
    )


def _declared(document: Document, number: int) -> int:
    """Return the number of triangles that a mesh declares."""
    mesh = document.entry("meshes", number)
    return sum(count_triangles(document, primitive, mode) for primitive, mode in primitives(mesh))


def _mesh(document: Document, number: int) -> tuple[Floats, Ints]:
    """Return a mesh, its primitives joined: vertices, shape (n, 3), and faces, shape (f, 3)."""
    vertices: list[Floats] = []
    faces: list[Ints] = []
    count = 0
    for primitive, mode in primitives(document.entry("meshes", number)):
        positions, triangles = read_triangles(document, primitive, mode)
        vertices.append(positions)
        faces.append(triangles + count)
        count += len(positions)
    return np.concatenate(vertices), np.concatenate(faces)
