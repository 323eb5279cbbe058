"""One model of a 3MF: its objects and build items (3MF Core Specification 1.3)."""

from dataclasses import dataclass, field

import numpy as np

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError, NonFiniteCoordinatesError
from core.io.checks import Limits, check_indices, shown, within
from core.io.package import Package, canonical
from core.io.parts import clean_name

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
# The namespace of the first drafts, which has the same elements.
_DRAFT = "http://schemas.microsoft.com/3dmanufacturing/2013/01"
_PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
# Extensions that do not change positions or triangles.
_HARMLESS = {
    _CORE,
    _DRAFT,
    _PRODUCTION,
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
    "http://schemas.microsoft.com/3dmanufacturing/slice/2015/07",
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07",
}
# The other extensions, by the part of their namespace that names them.
_EXTENSIONS = {
    "beamlattice": "beam lattice",
    "securecontent": "secure content (encryption)",
    "booleanoperations": "boolean operations",
    "displacement": "displacement",
    "implicit": "implicit functions",
    "volumetric": "volumetric",
}
_NAMES = "model object vertices vertex triangles triangle components component build item"
_MODEL, _OBJECT, _VERTICES, _VERTEX, _TRIANGLES, _TRIANGLE, _COMPONENTS, _COMPONENT, _BUILD, _ITEM = (
    f"{_CORE} {name}" for name in _NAMES.split()
)
_MILLIMETRES = {"micron": 1e-3, "millimeter": 1.0, "centimeter": 10.0}
_MILLIMETRES |= {"inch": 25.4, "foot": 304.8, "meter": 1e3}
_DEPTH = 64
# Rows that pass through Python's objects at a time.
_BLOCK = 65_536

Key = tuple[str, str]
"""Key of an object: the name of its part in lower case, and its id."""


@dataclass(frozen=True)
class Placed:
    """An instance of an object, and the instance that contains it; the matrix maps rows (x, y, z, 1)."""

    key: Key
    matrix: Floats
    above: "Placed | None" = None


@dataclass
class Solid:
    """A 3MF object: a mesh, vertices (n, 3) and faces (f, 3), checked, or instances of other objects.

    The `kind` is "model" or "surface"; or "support", "solidsupport" or "other", which do not belong to the
    shape. The `name` is empty if the file gives none.
    """

    kind: str
    vertices: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    faces: Ints = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))
    components: list[Placed] = field(default_factory=list)
    name: str = ""


class Model:
    """The content of one model part: its unit in millimetres, its objects and its build items."""

    def __init__(self, package: Package, part: str, limits: Limits) -> None:
        self.unit = 1.0
        self.solids: dict[Key, Solid] = {}
        self.items: list[Placed] = []
        self._part = canonical(part)
        self._limits = limits
        self._path: list[str] = []
        self._namespaces: dict[str | None, str] = {}
        self._solid = Solid("none")
        self._coordinates: list[str] = []
        self._corners: list[str] = []
        self._vertices: list[Floats] = []
        self._faces: list[Ints] = []
        self._count = [0, 0]
        self._components = 0
        package.parse(part, self._start, self._end, self._declare)

    def _declare(self, prefix: str | None, address: str) -> None:
        self._namespaces.setdefault(prefix, address)

    def _start(self, name: str, given: dict[str, str]) -> None:
        if name.startswith(_DRAFT):
            name = _CORE + name.removeprefix(_DRAFT)
        path = self._path
        above = path[-1] if path else ""
        path.append(name)
        # The most by far come first.
        if name == _TRIANGLE and above == _TRIANGLES:
            self._corners += (given["v1"], given["v2"], given["v3"])
            if len(self._corners) >= 3 * _BLOCK:
                self._take_faces()
        elif name == _VERTEX and above == _VERTICES:
            self._coordinates += (given["x"], given["y"], given["z"])
            if len(self._coordinates) >= 3 * _BLOCK:
                self._take_vertices()
        else:
            self._begin(name, above, given)

    def _begin(self, name: str, above: str, given: dict[str, str]) -> None:
        """Handle the start of an element other than a vertex or a triangle."""
        within(len(self._path), _DEPTH, "elements of XML inside each other")
        if name == _OBJECT:
            self._solid = Solid(given.get("type", "model"), name=clean_name(given.get("name")))
            key = (self._part, given["id"])
            if key in self.solids:
                raise MalformedMeshError("two objects of the 3MF have one id")
            self.solids[key] = self._solid
            within(len(self.solids), 16 * self._limits.parts, "objects")
        elif name == _COMPONENT and above == _COMPONENTS:
            self._components += 1
            within(self._components, 16 * self._limits.parts, "components")
            self._solid.components.append(self._placed(given))
        elif name == _ITEM and above == _BUILD:
            self.items.append(self._placed(given))
            within(len(self.items), self._limits.parts, "items")
        elif name == _MODEL:
            self._describe(given)
        elif not above:
            raise MalformedMeshError("the part of the 3MF that should be its model is something else")

    def _end(self, _: str) -> None:
        if self._path.pop() != _OBJECT:
            return
        self._take_vertices()
        self._take_faces()
        solid = self._solid
        if self._vertices:
            solid.vertices = np.concatenate(self._vertices)
        if self._faces:
            solid.faces = np.concatenate(self._faces)
        self._vertices, self._faces = [], []
        check_indices(solid.faces, len(solid.vertices))

    def _take_vertices(self) -> None:
        if self._coordinates:
            rows = numbers(self._coordinates).reshape(-1, 3)
            self._coordinates = []
            self._count[0] += len(rows)
            within(self._count[0], self._limits.vertices, "vertices")
            self._vertices.append(rows)

    def _take_faces(self) -> None:
        if self._corners:
            rows = numbers(self._corners)
            self._corners = []
            if (rows != np.trunc(rows)).any() or (abs(rows) >= 2.0**53).any():
                raise MalformedMeshError("a face has an index that is not a whole number")
            self._count[1] += len(rows) // 3
            within(self._count[1], self._limits.faces, "triangles")
            self._faces.append(rows.astype(np.int64).reshape(-1, 3))

    def _placed(self, given: dict[str, str]) -> Placed:
        part = canonical(given.get(f"{_PRODUCTION} path", self._part))
        return Placed((part, given["objectid"]), _matrix(given.get("transform")))

    def _describe(self, given: dict[str, str]) -> None:
        """Read the unit; raise if the model requires an unsupported extension."""
        unit = given.get("unit", "millimeter")
        if unit not in _MILLIMETRES:
            raise MalformedMeshError("the 3MF has a unit that the format does not know")
        self.unit = _MILLIMETRES[unit]
        for prefix in given.get("requiredextensions", "").split():
            if self._namespaces.get(prefix) not in _HARMLESS:
                address = self._namespaces.get(prefix, "")
                name = next((_EXTENSIONS[part] for part in _EXTENSIONS if part in address), shown(prefix))
                raise MalformedMeshError(f"the 3MF needs the extension for {name}, which is not read")


def numbers(texts: list[str]) -> Floats:
    """Parse decimal numbers.

    Raise MalformedMeshError for other texts, and NonFiniteCoordinatesError for NaN and infinity.
    """
    joined = "".join(texts)
    # Python's own float would take 1_000 for a thousand, and digits of any script.
    if "_" in joined or not joined.isascii():
        raise MalformedMeshError("a number in the 3MF is not one")
    try:
        values = np.fromiter(map(float, texts), dtype=np.float64, count=len(texts))
    except ValueError:
        raise MalformedMeshError("a number in the 3MF is not one") from None
    if not np.isfinite(values).all():
        raise NonFiniteCoordinatesError("a number in the 3MF is NaN or infinite")
    return values


def _matrix(text: str | None) -> Floats:
    """Return the matrix, shape (4, 4), of twelve numbers: its rows without the last column."""
    matrix = np.eye(4)
    if text is not None:
        values = numbers(text.split())
        if len(values) != 12:
            raise MalformedMeshError("a transform in the 3MF does not have twelve numbers")
        matrix[:, :3] = values.reshape(4, 3)
    return matrix
