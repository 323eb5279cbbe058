"""Files at the limits and past them."""

import numpy as np

from core.io import write_mesh
from core.mesh.mesh import Mesh
from tests.core.io.files import PLAIN
from tests.soak.hostile.bodies import sheet
from tests.soak.hostile.case import STORED, Hostile

SIDE = 1_000
LIMIT = 128 << 20


def cases() -> list[Hostile]:
    """All of them."""
    return [
        *(
            Hostile(
                "million", f"million.{format}", lambda format=format: _million(format), *STORED, slow=True
            )
            for format in PLAIN
        ),
        Hostile("limit", "vertices.off", _many_vertices, 422, "mesh-too-complex", slow=True),
        Hostile("limit", "faces.obj", _many_triangles, 422, "mesh-too-complex", slow=True),
        Hostile("limit", "fans.off", _fans, 422, "mesh-too-complex", slow=True),
        Hostile("limit", "bytes.off", lambda: b"x" * (LIMIT + 1), 413, "body-too-large", slow=True),
        Hostile("limit", "bytes.stl", lambda: bytes(2 * LIMIT), 413, "body-too-large", slow=True),
    ]


def _million(format: str) -> bytes:
    vertices, faces = sheet(SIDE)
    # In few digits, as programs write them: seventeen would make the OBJ larger than is taken.
    return write_mesh(Mesh(np.round(vertices, 6), faces), format)


def _many_vertices() -> bytes:
    return b"OFF\n2000001 1 0\n" + b"0 1 2\n" * 2_000_001 + b"3 0 1 2\n"


def _many_triangles() -> bytes:
    return b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"f 1 2 3\n" * 4_000_001


def _fans() -> bytes:
    """Polygons that are few, with 4,000,001 triangles."""
    polygon = b"10003 " + b"0 1 2 " * 3334 + b"0\n"
    return b"OFF\n3 401 0\n0 0 0\n1 0 0\n0 1 0\n" + polygon * 401
