"""Triangulation of STEP files (ISO 10303-21) by cascadio, a binding of OpenCASCADE."""

import re
from importlib.util import find_spec

from core.errors import ExternalReferenceError, MalformedMeshError
from core.io.checks import Limits
from core.io.step_products import check_products

MILLIMETRES = 1_000.0
"""Millimetres in a metre; cascadio writes metres for any unit of the file."""

# The farthest that a triangle may lie from the surface, over the length of the edge beside it, and the widest
# angle between normals of neighbours, in radians: a sphere of any size has about a thousand triangles.
_LINEAR, _ANGULAR = 0.01, 0.5
# The entities that name other files, which OpenCASCADE would open, in full and as its short names.
_ELSEWHERE = re.compile(rb"\b(?:DOCUMENT_FILE|DCMFL)\b", re.IGNORECASE)


def is_read() -> bool:
    """Whether cascadio is installed."""
    return find_spec("cascadio") is not None


def to_glb(data: bytes, limits: Limits) -> bytes:
    """Return a STEP file as a GLB, in metres.

    A node of the GLB is an instance of a product and has the name of the instance, or of the product for a
    root; a mesh has the name of its product. Beyond the number of instances, only the limits of the process
    bound the time and memory of OpenCASCADE on a hostile file.

    Raises
    ------
    MalformedMeshError
        The file is not STEP, has nothing that can be triangulated, or a product contains itself.
    ExternalReferenceError
        The file refers to another file.
    MeshTooComplexError
        The assemblies place more instances than the limits.
    """
    if not data.lstrip().startswith(b"ISO-10303-21;"):
        raise MalformedMeshError("the file does not begin as a STEP does")
    if _ELSEWHERE.search(data):
        raise ExternalReferenceError("the STEP refers to another file; export it as one file")
    check_products(data, limits)
    # Not everyone has it, and it takes 80 MB.
    import cascadio  # noqa: PLC0415

    glb: bytes = cascadio.load(
        data,
        file_type="step",
        tol_linear=_LINEAR,
        tol_angular=_ANGULAR,
        tol_relative=True,
        use_parallel=False,
    )
    if not glb:
        raise MalformedMeshError("the STEP cannot be read, or is cut short")
    return glb
