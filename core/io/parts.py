"""Reading the parts of an assembly from the bytes of a file."""

from dataclasses import replace

from core.errors import DegenerateMeshError, NoTrianglesError
from core.io import gltf_parts, step, threemf_parts
from core.io.checks import DEFAULT_LIMITS, Limits
from core.io.formats import known
from core.io.part import Part
from core.io.read import is_degenerate, reading
from core.mesh.mesh import Mesh


def read_parts(data: bytes, format: str, *, limits: Limits = DEFAULT_LIMITS) -> list[Part]:
    """Read the distinct parts of an assembly.

    The parts of a STEP are its products with triangles, and those of a 3MF its objects, each in its own
    frame, in millimetres. Parts with the same name and the same mesh are one.

    Parameters
    ----------
    data : bytes
        The whole file.
    format : str
        One of `READABLE`.
    limits : Limits
        The largest assembly that is read.

    Returns
    -------
    parts : list of Part
        In the order of their first instances in the file. It is empty if the file has one instance of one
        part, or is of another format.

    Raises
    ------
    MeshError
        The file cannot be read, as in `read_mesh`; or it has more different parts than the limits, or a part
        has no face of any area.
    """
    name = known(format)
    with reading(data, name):
        parts = _read(data, name, limits)
    for part in parts:
        if is_degenerate(part.mesh):
            raise DegenerateMeshError(f"every face of the part {part.name!r} has zero area")
    return parts if sum(part.instances for part in parts) > 1 else []


def _read(data: bytes, name: str, limits: Limits) -> list[Part]:
    if name == "3mf":
        return threemf_parts.read_parts(data, limits)
    if name != "step":
        return []
    try:
        parts = gltf_parts.read_parts(step.to_glb(data, limits), limits)
    except NoTrianglesError:
        raise NoTrianglesError("nothing in the STEP can be made into triangles") from None
    return [
        replace(part, mesh=Mesh(part.mesh.vertices * step.MILLIMETRES, part.mesh.faces)) for part in parts
    ]
