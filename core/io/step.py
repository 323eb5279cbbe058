"""STEP (ISO 10303-21), by cascadio, which is OpenCASCADE: solids and surfaces made into triangles."""

import re
from importlib.util import find_spec

from core.errors import ExternalReferenceError, MalformedMeshError

MILLIMETRES = 1_000.0
"""cascadio writes metres, whatever the unit of the file."""

# The farthest that a triangle may lie from the surface, over the length of the edge beside it, and the widest
# angle between normals of neighbours, in radians: a sphere of any size has about a thousand triangles.
_LINEAR, _ANGULAR = 0.01, 0.5
# The entities that name other files, which OpenCASCADE would open, in full and as its short names.
_ELSEWHERE = re.compile(rb"\b(?:DOCUMENT_FILE|DCMFL)\b", re.IGNORECASE)


def is_read() -> bool:
    """Say whether there is what reads STEP."""
    return find_spec("cascadio") is not None


def to_glb(data: bytes) -> bytes:
    """Return a STEP file as a GLB, in metres.

    What a hostile file makes OpenCASCADE take, of time and of memory, is bounded by the process alone.

    Raises
    ------
    MalformedMeshError
        It is no STEP, or nothing in it can be made into triangles.
    ExternalReferenceError
        A part of it is kept in another file.
    """
    if not data.lstrip().startswith(b"ISO-10303-21;"):
        raise MalformedMeshError("the file does not begin as a STEP does")
    if _ELSEWHERE.search(data):
        raise ExternalReferenceError("the STEP refers to another file; export it as one file")
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
