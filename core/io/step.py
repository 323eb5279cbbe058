"""Reading STEP (ISO 10303-21) by cascadio, a binding of OpenCASCADE, which triangulates it and writes GLB."""

import re
from collections.abc import Callable
from graphlib import CycleError, TopologicalSorter
from typing import Literal, TypeVar

import numpy as np

from core.arrays import Floats, Ints
from core.errors import ExternalReferenceError, MalformedMeshError, MeshTooComplexError, NoTrianglesError
from core.io import glb
from core.io.checks import Content, Limits
from core.io.parts import Part

# The farthest that a triangle may lie from the surface, over the length of the edge beside it, and the widest
# angle between normals of neighbours, in radians: a sphere of any size has about a thousand triangles.
_LINEAR, _ANGULAR = 0.01, 0.5
# The entities that name other files, which OpenCASCADE would open, in full and as its short names, and names
# as long of entities that are none.
_ELSEWHERE = re.compile(rb"\b(DOCUMENT_FILE|DCMFL)\b", re.IGNORECASE)
_NOWHERE = {len(name): b"X" * len(name) for name in (b"DOCUMENT_FILE", b"DCMFL")}
_SOLID = re.compile(rb"\bMANIFOLD_SOLID_BREP\b", re.IGNORECASE)
# The most triangles whose edges are counted, in half a second.
_CHECKED = 200_000
_INSTANCES_PER_PART = 16
# An instance: its id, name and description, of at most 1,024 characters each; the product that contains it,
# and the product that it is an instance of. The quantifiers do not backtrack, so the time is linear.
_INSTANCE = re.compile(
    rb"\b(?:NEXT_ASSEMBLY_USAGE_OCCURRENCE|NAUO)\s{0,64}+\((?:'[^']{0,1024}+'|[^'#;)]){0,256}+"
    rb"#(\d{1,18}+)\s{0,64}+,\s{0,64}+#(\d{1,18}+)",
    re.IGNORECASE,
)

_Content = TypeVar("_Content")


def read(data: bytes, limits: Limits) -> Content:
    """Return the vertices of a STEP in millimetres, and its faces."""
    if not data.lstrip().startswith(b"ISO-10303-21;"):
        raise MalformedMeshError("the file does not begin as a STEP does")
    content = from_glb(glb.read, data, limits, "step")
    warnings = []
    if _ELSEWHERE.search(data):
        warnings.append("the STEP names other files, which are left out")
    if len(content.faces) <= _CHECKED and _SOLID.search(data) and _is_open(content.vertices, content.faces):
        warnings.append("a solid of the STEP is open: some of its faces could not be made into triangles")
    return content._replace(warnings=tuple(warnings))


def _is_open(vertices: Floats, faces: Ints) -> bool:
    """Return whether an edge has one face only, once vertices at one position are one."""
    corners = np.unique(vertices, axis=0, return_inverse=True)[1].reshape(-1)[faces]
    edges = np.sort(corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges = edges[edges[:, 0] < edges[:, 1]]
    counts = np.unique(edges[:, 0] * len(vertices) + edges[:, 1], return_counts=True)[1]
    return bool((counts == 1).any())


def read_parts(data: bytes, limits: Limits) -> list[Part]:
    """Return the distinct products with triangles, each in its own frame, in millimetres."""
    return from_glb(glb.read_parts, data, limits, "step")


def from_glb(
    read_glb: Callable[[bytes, Limits], _Content], data: bytes, limits: Limits, type: Literal["step", "iges"]
) -> _Content:
    """Return the content of a "step" or "iges" by way of a GLB, whose unit is the metre for any of the file.

    A node of the GLB is an instance of a product and has the name of the instance, or of the product for a
    root; a mesh has the name of its product. No file that a STEP names is opened. Beyond the number of
    instances, only the limits of the process bound the time and memory of OpenCASCADE on a hostile file.

    Raise MalformedMeshError if nothing can be triangulated, ExternalReferenceError if that is so because all
    is in other files, and the errors of `check_products`.
    """
    sealed = _ELSEWHERE.sub(lambda name: _NOWHERE[len(name[0])], data)
    check_products(sealed, limits)
    # Not every installation has it, and it takes 80 MB.
    import cascadio  # noqa: PLC0415

    converted: bytes = cascadio.load(
        sealed,
        file_type=type,
        tol_linear=_LINEAR,
        tol_angular=_ANGULAR,
        tol_relative=True,
        use_parallel=False,
    )
    try:
        if converted:
            return read_glb(converted, limits)
    except NoTrianglesError:
        pass
    if sealed != data:
        raise ExternalReferenceError("the STEP refers to another file; export it as one file")
    if converted:
        raise NoTrianglesError(f"nothing in the {type.upper()} can be made into triangles")
    raise MalformedMeshError(f"the {type.upper()} cannot be read, or is cut short")


def check_products(data: bytes, limits: Limits) -> None:
    """Refuse assemblies that OpenCASCADE would expand without end, or into too many instances.

    The cost is that of one pass over the text, whatever the depth of the assemblies. Entities with comments
    inside, or with a text of more than 1,024 characters, are not counted; the limits of the process bound
    those. Raise MalformedMeshError if a product contains itself, and MeshTooComplexError if the assemblies
    place more than 16 instances, assemblies included, for each part of the limit.
    """
    components: dict[int, list[int]] = {}
    for instance in _INSTANCE.finditer(data):
        components.setdefault(int(instance[1]), []).append(int(instance[2]))
    most = _INSTANCES_PER_PART * limits.parts
    try:
        order = list(TopologicalSorter(components).static_order())
    except CycleError:
        raise MalformedMeshError("a product of the STEP is a part of itself") from None
    # Components come before the products that contain them.
    inside: dict[int, int] = {}
    for product in order:
        inside[product] = sum(1 + inside[component] for component in components.get(product, ()))
        if inside[product] > most:
            raise MeshTooComplexError(
                f"the STEP has more than {most} instances of parts and assemblies, the limit"
            )
