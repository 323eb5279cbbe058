"""The distinct meshes of a glTF scene, with their names and numbers of instances."""

from collections.abc import Callable, Iterator

from core.io.checks import Limits
from core.io.glb import Scene, read_scene
from core.io.gltf_document import Document
from core.io.gltf_scene import parents
from core.io.part import PATH_NAMES, Part, clean_name, distinct_parts, mesh_digest
from core.mesh.mesh import Mesh


def read_parts(data: bytes, limits: Limits) -> list[Part]:
    """Return the distinct meshes of a GLB, each in its own frame, in the order of their first instances.

    Meshes with the same name, vertices and faces are one part.

    Raises
    ------
    MeshError
        The file is malformed or exceeds the limits; the subclass tells the kind of fault.
    """
    return distinct_parts(_instances(read_scene(data, limits)), limits)


def _instances(scene: Scene) -> Iterator[tuple[tuple[str, bytes], Callable[[], Part]]]:
    above = parents(scene.document)
    digests = {number: mesh_digest(*mesh) for number, mesh in scene.meshes.items()}
    for one in scene.instances:
        if one.mesh not in scene.meshes:
            continue
        name = clean_name(scene.document.entry("meshes", one.mesh).get("name"))

        def part(name: str = name, node: int = one.node, mesh: int = one.mesh) -> Part:
            return Part(name, _path(scene.document, above, node), 1, Mesh(*scene.meshes[mesh]))

        yield (name, digests[one.mesh]), part


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
