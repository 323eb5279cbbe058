"""Reading IGES (5.3) by cascadio, as STEP is."""

from core.io import glb
from core.io.checks import Content, Limits
from core.io.step import from_glb


def read(data: bytes, limits: Limits) -> Content:
    """Return the vertices of an IGES in millimetres, and its faces."""
    content = from_glb(glb.read, data, limits, "iges")
    # Other than for a STEP, cascadio writes millimetres where GLB has metres.
    return content._replace(vertices=content.vertices / glb.MILLIMETRES)
