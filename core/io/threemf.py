"""Reading and writing 3MF: a ZIP of XML models, whose build items place meshes or assemblies of objects."""

import math
from collections import Counter
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter

import numpy as np

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError, NoTrianglesError
from core.io.checks import Content, Limits, joined, within
from core.io.package import Package, pack
from core.io.parts import PATH_NAMES, Part, distinct, mesh_digest
from core.io.text import face_lines, vertex_lines
from core.io.threemf_model import Key, Model, Placed, Solid
from core.mesh.mesh import Mesh

# Parts of a package that are models; slicers write one for each object.
_MODELS = 4_096
_VISITS_PER_PART = 16
_SHOWN = {"model", "surface"}
# Rotations are written in few digits.
_ROUNDING = 1e-5
_DIGITS, _KEY_DIGITS = 6, 4


def read(data: bytes, limits: Limits) -> Content:
    """Return the vertices and faces of all build items, in millimetres.

    Objects of the types for support and helpers are left out, as are materials, slices and pictures. The
    faces of a mirrored object are reversed, so they stay oriented outwards. If the build has no items, every
    object that is no component of another is read where it is.
    """
    solids, placed, unit, warnings = _read_placed(data, limits)
    vertices, faces = joined(
        _transformed(solids[instance.key], instance.matrix[:3, :3], instance.matrix[3, :3], unit)
        for instance in placed
    )
    return Content(vertices, faces, warnings)


def read_parts(data: bytes, limits: Limits) -> list[Part]:
    """Return the distinct objects that the build places, each in its own frame, in millimetres.

    An object without a name has that of the nearest object above it. Instances of an object that are scaled,
    stretched or mirrored differently are different parts: a part has the stretch of its instances, without
    their rotation.
    """
    solids, placed, unit, _ = _read_placed(data, limits)
    return [
        Part(path[-1] if path else "", path, times, Mesh(*_transformed(solid, stretch, np.zeros(3), unit)))
        for (path, solid, stretch), times in distinct(_keyed(solids, placed), limits)
    ]


def write(mesh: Mesh) -> bytes:
    """Return a mesh as a 3MF of one object and one build item, with its coordinates in millimetres.

    The format forbids faces that name a vertex twice; they are left out. Nothing else changes: an open
    surface stays open. Raise NoTrianglesError if every face names a vertex twice.
    """
    a, b, c = mesh.faces.T
    faces = mesh.faces[(a != b) & (b != c) & (c != a)]
    if not len(faces):
        raise NoTrianglesError("each face of the mesh names a vertex twice, which a 3MF may not hold")
    return pack(
        vertex_lines(mesh.vertices, '<vertex x="%r" y="%r" z="%r"/>\n'),
        face_lines(faces, '<triangle v1="%d" v2="%d" v3="%d"/>\n'),
    )


def _read_placed(
    data: bytes, limits: Limits
) -> tuple[dict[Key, Solid], list[Placed], float, tuple[str, ...]]:
    """Return the objects, every instance of one with faces, the unit in millimetres, and warnings."""
    package = Package(data, limits)
    solids, items, unit = _models(package, limits)
    _refuse_circles(solids)
    warnings: tuple[str, ...] = ()
    if not items:
        warnings = ("the build of the 3MF is empty: all of its objects are read",)
        inside = {component.key for solid in solids.values() for component in solid.components}
        items = [Placed(key, np.eye(4)) for key in solids if key not in inside]
    placed = _expand(solids, items, limits)
    if not placed:
        raise NoTrianglesError("the build of the 3MF places no triangles")
    within(sum(len(solids[instance.key].faces) for instance in placed), limits.faces, "triangles")
    within(sum(len(solids[instance.key].vertices) for instance in placed), limits.vertices, "vertices")
    return solids, placed, unit, warnings


def _models(package: Package, limits: Limits) -> tuple[dict[Key, Solid], list[Placed], float]:
    """Return the objects of all referenced models, and the build items and the unit of the first model."""
    first = package.model()
    solids: dict[Key, Solid] = {}
    items: list[Placed] = []
    unit = 0.0
    counts = Counter[str]()
    seen, waiting = {first}, [first]
    while waiting:
        part = waiting.pop()
        model = Model(package, part, limits)
        if part == first:
            items, unit = model.items, model.unit
        elif model.unit != unit:
            raise MalformedMeshError("the models in the 3MF have different units")
        solids.update(model.solids)
        references = list(items) if part == first else []
        for solid in model.solids.values():
            counts.update(vertices=len(solid.vertices), triangles=len(solid.faces))
            references += solid.components
        counts.update(components=len(references))
        within(counts["vertices"], limits.vertices, "vertices")
        within(counts["triangles"], limits.faces, "triangles")
        within(counts["components"], _VISITS_PER_PART * limits.parts, "components")
        parts = {reference.key[0] for reference in references} - seen
        seen |= parts
        within(len(seen), _MODELS, "models")
        waiting += sorted(parts)
    return solids, items, unit


def _refuse_circles(solids: dict[Key, Solid]) -> None:
    """Raise if an object contains itself or refers to a missing object."""
    graph = {key: {component.key for component in solid.components} for key, solid in solids.items()}
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
        instance = waiting.pop()
        visits += 1
        within(visits, _VISITS_PER_PART * limits.parts, "places of objects")
        if instance.key not in solids:
            raise MalformedMeshError("the build of the 3MF refers to an object that is not there")
        solid = solids[instance.key]
        if solid.kind not in _SHOWN:
            continue
        if len(solid.faces):
            placed.append(instance)
            within(len(placed), limits.parts, "places of meshes")
        waiting += [
            Placed(part.key, part.matrix @ instance.matrix, instance) for part in reversed(solid.components)
        ]
        within(len(waiting), _VISITS_PER_PART * limits.parts, "places of objects")
    return placed


def _transformed(solid: Solid, matrix: Floats, shift: Floats, unit: float) -> tuple[Floats, Ints]:
    """Return the vertices and faces of a transformed object; faces of a mirrored one are reversed."""
    faces = solid.faces[:, ::-1] if np.linalg.det(matrix) < 0 else solid.faces
    return (solid.vertices @ matrix + shift) * unit, faces


def _keyed(
    solids: dict[Key, Solid], placed: list[Placed]
) -> Iterator[tuple[tuple[str, bytes, bytes], tuple[tuple[str, ...], Solid, Floats]]]:
    """Yield the name, mesh and stretch of each instance, and its path, object and stretch."""
    digests = {
        key: mesh_digest(solids[key].vertices, solids[key].faces)
        for key in {instance.key for instance in placed}
    }
    for instance in placed:
        path, stretch = _path(solids, instance), _stretch(instance.matrix[:3, :3])
        key = path[-1] if path else "", digests[instance.key], _rounded(stretch, _KEY_DIGITS).tobytes()
        yield key, (path, solids[instance.key], stretch)


def _path(solids: dict[Key, Solid], placed: Placed) -> tuple[str, ...]:
    """Return the names from the build item to an instance; objects without a name are left out."""
    names: list[str] = []
    instance: Placed | None = placed
    while instance is not None and len(names) < PATH_NAMES:
        names.append(solids[instance.key].name)
        instance = instance.above
    return tuple(name for name in reversed(names) if name)


def _stretch(matrix: Floats) -> Floats:
    """Return the symmetric factor S of the polar decomposition A = S R of a transform of rows, shape (3, 3).

    S is the identity for a rotation. If A mirrors, -S is returned: R is then a rotation too.
    """
    squares, axes = np.linalg.eigh(matrix @ matrix.T)
    stretch = (axes * np.sqrt(np.maximum(squares, 0.0))) @ axes.T
    if np.abs(stretch - np.eye(3)).max() <= _ROUNDING:
        stretch = np.eye(3)
    return _rounded(-stretch if np.linalg.det(matrix) < 0 else stretch, _DIGITS)


def _rounded(stretch: Floats, digits: int) -> Floats:
    """Return the numbers rounded to so many digits of the largest one."""
    largest = float(np.abs(stretch).max())
    decimals = digits - math.floor(math.log10(largest)) if largest > 0 else 0
    # Without negative zeros, which have other bytes.
    return np.asarray(np.round(stretch, decimals) + 0.0)
