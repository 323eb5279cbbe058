"""The distinct meshes of a glTF scene, with their names and numbers of instances."""

import hashlib
from dataclasses import replace

from core.arrays import Floats, Ints
from core.io.checks import Limits, within
from core.io.glb import read_scene
from core.io.gltf_document import Document
from core.io.gltf_scene import parents
from core.io.part import PATH_NAMES, Part, clean_name
from core.mesh.mesh import Mesh


def read_parts(data: bytes, limits: Limits) -> list[Part]:
    """Return the distinct meshes of a GLB, each in its own frame, in the order of their first instances.

    Meshes with the same name, vertices and faces are one part.

    Raises
    ------
    MeshError
        The file is malformed or exceeds the limits; the subclass tells the kind of fault.
    """
    scene = read_scene(data, limits)
    above = parents(scene.document)
    digests = {number: _digest(*mesh) for number, mesh in scene.meshes.items()}
    parts: dict[tuple[str, bytes], Part] = {}
    for one in scene.instances:
        if one.mesh not in scene.meshes:
            continue
        name = clean_name(scene.document.entry("meshes", one.mesh).get("name"))
        key = name, digests[one.mesh]
        if key in parts:
            parts[key] = replace(parts[key], instances=parts[key].instances + 1)
            continue
        within(len(parts) + 1, limits.distinct_parts, "different parts")
        parts[key] = Part(name, _path(scene.document, above, one.node), 1, Mesh(*scene.meshes[one.mesh]))
    return list(parts.values())


def _path(document: Document, above: dict[int, int], node: int | None) -> tuple[str, ...]:
    """Return the names from the root to a node."""
    names: list[str] = []
    while node is not None and len(names) < PATH_NAMES:
        names.append(_node_name(document, node))
        node = above.get(node)
    return tuple(reversed(names))


def _node_name(document: Document, number: int) -> str:
    """Return the name of a node, or of its mesh if it has none."""
    node = document.entry("nodes", number)
    name = clean_name(node.get("name"))
    return name or (clean_name(document.entry("meshes", node["mesh"]).get("name")) if "mesh" in node else "")


def _digest(vertices: Floats, faces: Ints) -> bytes:
    """Return a hash of a mesh."""
    digest = hashlib.sha256(vertices.tobytes())
    digest.update(faces.tobytes())
    return digest.digest()
