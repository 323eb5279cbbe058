"""Reading STEP (ISO 10303-21) by cascadio, a binding of OpenCASCADE, which triangulates it and writes GLB."""

import re
from collections.abc import Callable
from dataclasses import replace
from graphlib import CycleError, TopologicalSorter
from typing import TypeVar

from core.arrays import Floats, Ints
from core.errors import ExternalReferenceError, MalformedMeshError, MeshTooComplexError, NoTrianglesError
from core.io import glb
from core.io.checks import Limits
from core.io.parts import Part
from core.mesh.mesh import Mesh

# Millimetres in a metre; cascadio writes metres for any unit of the file.
_MILLIMETRES = 1_000.0
# The farthest that a triangle may lie from the surface, over the length of the edge beside it, and the widest
# angle between normals of neighbours, in radians: a sphere of any size has about a thousand triangles.
_LINEAR, _ANGULAR = 0.01, 0.5
# The entities that name other files, which OpenCASCADE would open, in full and as its short names.
_ELSEWHERE = re.compile(rb"\b(?:DOCUMENT_FILE|DCMFL)\b", re.IGNORECASE)
_INSTANCES_PER_PART = 16
# An instance: its id, name and description, of at most 1,024 characters each; the product that contains it,
# and the product that it is an instance of. The quantifiers do not backtrack, so the time is linear.
_INSTANCE = re.compile(
    rb"\b(?:NEXT_ASSEMBLY_USAGE_OCCURRENCE|NAUO)\s{0,64}+\((?:'[^']{0,1024}+'|[^'#;)]){0,256}+"
    rb"#(\d{1,18}+)\s{0,64}+,\s{0,64}+#(\d{1,18}+)",
    re.IGNORECASE,
)

_Content = TypeVar("_Content")


def read(data: bytes, limits: Limits) -> tuple[Floats, Ints]:
    """Return the vertices of a STEP in millimetres, shape (n, 3), and its faces, shape (f, 3)."""
    vertices, faces = _from_glb(glb.read, data, limits)
    return vertices * _MILLIMETRES, faces


def read_parts(data: bytes, limits: Limits) -> list[Part]:
    """Return the distinct products with triangles, each in its own frame, in millimetres."""
    parts = _from_glb(glb.read_parts, data, limits)
    return [replace(part, mesh=Mesh(part.mesh.vertices * _MILLIMETRES, part.mesh.faces)) for part in parts]


def _from_glb(read_glb: Callable[[bytes, Limits], _Content], data: bytes, limits: Limits) -> _Content:
    """Return the content of the GLB of a STEP."""
    try:
        return read_glb(_to_glb(data, limits), limits)
    except NoTrianglesError:
        raise NoTrianglesError("nothing in the STEP can be made into triangles") from None


def _to_glb(data: bytes, limits: Limits) -> bytes:
    """Return a STEP file as a GLB, in metres.

    A node of the GLB is an instance of a product and has the name of the instance, or of the product for a
    root; a mesh has the name of its product. Beyond the number of instances, only the limits of the process
    bound the time and memory of OpenCASCADE on a hostile file.

    Raise MalformedMeshError if nothing can be triangulated, ExternalReferenceError if the file refers to
    another file, and the errors of `check_products`.
    """
    if _ELSEWHERE.search(data):
        raise ExternalReferenceError("the STEP refers to another file; export it as one file")
    check_products(data, limits)
    # Not every installation has it, and it takes 80 MB.
    import cascadio  # noqa: PLC0415

    converted: bytes = cascadio.load(
        data,
        file_type="step",
        tol_linear=_LINEAR,
        tol_angular=_ANGULAR,
        tol_relative=True,
        use_parallel=False,
    )
    if not converted:
        raise MalformedMeshError("the STEP cannot be read, or is cut short")
    return converted


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
