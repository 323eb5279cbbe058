"""The nodes of a glTF scene."""

from core.errors import MalformedMeshError, MeshTooComplexError
from core.reading.gltf_document import Document, Entry
from core.reading.plain import Limits, within

# A transform by its name, and the numbers it has. A matrix stands alone.
_TRANSFORMS = {"translation": 3, "rotation": 4, "scale": 3}
_DEEPEST = 128
_NODES_PER_PART = 16


def place(document: Document, limits: Limits) -> tuple[list[Entry], list[int]]:
    """Copy the nodes of the scene, with nothing but their transforms, children and meshes.

    The mesh of a skinned node is placed at the origin: the node's own transform does not apply to it
    (glTF 2.0, section 3.7.3.3), and its joints are left at rest.

    Returns
    -------
    nodes : list of dict
    roots : list of int
        Indices into `nodes`.
    """
    entries = document.entries("nodes")
    within(len(entries), _NODES_PER_PART * limits.parts, "nodes")
    nodes: list[Entry] = []
    roots: list[int] = []
    visited: set[int] = set()
    waiting: list[tuple[object, list[int], int]] = [(root, roots, 1) for root in reversed(_roots(document))]
    while waiting:
        number, siblings, depth = waiting.pop()
        entry = document.entry("nodes", number)
        assert isinstance(number, int)
        if number in visited:
            raise MalformedMeshError("a node of the GLB is reached twice")
        if depth > _DEEPEST:
            raise MeshTooComplexError(f"the nodes of the GLB are nested deeper than {_DEEPEST}")
        visited.add(number)
        node = _transform(entry)
        node["children"] = []
        siblings.append(len(nodes))
        nodes.append(node)
        if "mesh" in entry:
            document.entry("meshes", entry["mesh"])
            if "skin" in entry:
                roots.append(len(nodes))
                nodes.append({"mesh": entry["mesh"]})
            else:
                node["mesh"] = entry["mesh"]
        children = entry.get("children", [])
        if not isinstance(children, list):
            raise MalformedMeshError("the children of a node of the GLB are not a list")
        waiting += [(child, node["children"], depth + 1) for child in reversed(children)]
    return nodes, roots


def _roots(document: Document) -> list[object]:
    """Return the roots of the scene; of all nodes, if there is no scene."""
    if document.entries("scenes"):
        roots = document.entry("scenes", document.tree.get("scene", 0)).get("nodes", [])
        if not isinstance(roots, list):
            raise MalformedMeshError("the nodes of a scene of the GLB are not a list")
        return roots
    entries = document.entries("nodes")
    children = {child for entry in entries for child in entry.get("children", [])}
    return [number for number in range(len(entries)) if number not in children]


def _transform(entry: Entry) -> Entry:
    """Return the transform of a node, its numbers checked."""
    if "matrix" in entry:
        return {"matrix": _numbers(entry["matrix"], 16)}
    return {name: _numbers(entry[name], size) for name, size in _TRANSFORMS.items() if name in entry}


def _numbers(values: object, size: int) -> list[float]:
    if (
        not isinstance(values, list)
        or len(values) != size
        or not all(type(v) in (int, float) for v in values)
    ):
        raise MalformedMeshError("a transform in the GLB is not made of the numbers it should be")
    return [float(value) for value in values]
