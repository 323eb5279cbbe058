"""Reading 3MF: a ZIP of XML models, whose build items place objects (meshes or assemblies of objects)."""

from graphlib import CycleError, TopologicalSorter

import numpy as np

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError, NoTrianglesError
from core.io.checks import Limits, within
from core.io.threemf_model import Key, Model, Placed, Solid, canonical
from core.io.threemf_package import Package
from core.mesh.mesh import Mesh

# Parts of a package that are models; slicers write one for each object.
_MODELS = 4_096
_VISITS_PER_PART = 16
_SHOWN = {"model", "surface"}


def read(data: bytes, limits: Limits) -> Mesh:
    """Return all build items, joined, in millimetres for any unit of the file.

    Objects of the types for support and helpers are left out, as are materials, slices and pictures. The
    faces of a mirrored object are reversed, so they stay oriented outwards.

    Raises
    ------
    MeshError
        The file is malformed or exceeds the limits; the subclass tells the kind of fault.
    """
    solids, placed, unit = read_placed(data, limits)
    vertices: list[Floats] = []
    faces: list[Ints] = []
    count = 0
    for one in placed:
        solid = solids[one.key]
        vertices.append((solid.vertices @ one.matrix[:3, :3] + one.matrix[3, :3]) * unit)
        mirrored = np.linalg.det(one.matrix[:3, :3]) < 0
        faces.append((solid.faces[:, ::-1] if mirrored else solid.faces) + count)
        count += len(solid.vertices)
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def read_placed(data: bytes, limits: Limits) -> tuple[dict[Key, Solid], list[Placed], float]:
    """Return the objects, every instance of an object with faces, and the unit in millimetres.

    It raises the errors of `read`.
    """
    package = Package(data, limits)
    solids, items, unit = _models(package, limits)
    _refuse_circles(solids)
    placed = _expand(solids, items, limits)
    if not placed:
        raise NoTrianglesError("the build of the 3MF places no triangles")
    within(sum(len(solids[one.key].faces) for one in placed), limits.faces, "triangles")
    within(sum(len(solids[one.key].vertices) for one in placed), limits.vertices, "vertices")
    return solids, placed, unit


def _models(package: Package, limits: Limits) -> tuple[dict[Key, Solid], list[Placed], float]:
    """Return the objects of all referenced models, and the build items and the unit of the first model."""
    first = canonical(package.model())
    root = Model(package, first, limits)
    solids = dict(root.solids)
    seen = {first}
    waiting = [root]
    while waiting:
        model = waiting.pop()
        references = [
            *(model.items if model is root else ()),
            *(p for s in model.solids.values() for p in s.components),
        ]
        for part in dict.fromkeys(one.key[0] for one in references):
            if part in seen:
                continue
            seen.add(part)
            within(len(seen), _MODELS, "models")
            other = Model(package, part, limits)
            if other.unit != root.unit:
                raise MalformedMeshError("the models in the 3MF have different units")
            solids.update(other.solids)
            within(sum(len(s.vertices) for s in solids.values()), limits.vertices, "vertices")
            within(sum(len(s.faces) for s in solids.values()), limits.faces, "triangles")
            waiting.append(other)
    return solids, root.items, root.unit


def _refuse_circles(solids: dict[Key, Solid]) -> None:
    """Raise if an object contains itself or refers to a missing object."""
    graph = {key: {one.key for one in solid.components} for key, solid in solids.items()}
    if not set().union(*graph.values()) <= set(solids):
        raise MalformedMeshError("a component of the 3MF refers to an object that is not there")
    try:
        TopologicalSorter(graph).prepare()
    except CycleError:
        raise MalformedMeshError("an object of the 3MF is a part of itself") from None


def _expand(solids: dict[Key, Solid], items: list[Placed], limits: Limits) -> list[Placed]:
    """Return every instance of every mesh."""
    placed: list[Placed] = []
    visits = 0
    waiting = list(reversed(items))
    while waiting:
        one = waiting.pop()
        visits += 1
        within(visits, _VISITS_PER_PART * limits.parts, "places of objects")
        if one.key not in solids:
            raise MalformedMeshError("the build of the 3MF refers to an object that is not there")
        solid = solids[one.key]
        if solid.kind not in _SHOWN:
            continue
        if len(solid.faces):
            placed.append(one)
            within(len(placed), limits.parts, "places of meshes")
        waiting += [Placed(part.key, part.matrix @ one.matrix, one) for part in reversed(solid.components)]
        within(len(waiting), _VISITS_PER_PART * limits.parts, "places of objects")
    return placed
