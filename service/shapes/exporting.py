"""Export of stored meshes to other file formats."""

from starlette.concurrency import run_in_threadpool

from core.errors import MeshTooComplexError
from core.io import write_mesh
from core.mesh.mesh import Mesh
from service.collection import CollectionNumber
from service.container import Container
from service.shapes.records import ShapeRecord
from service.shapes.service import get_file

_VERTEX = {"obj": 80, "off": 78, "ply": 12, "glb": 12, "stl": 0, "3mf": 98}
_FACE = {"obj": 30, "off": 31, "ply": 13, "glb": 12, "stl": 50, "3mf": 58}
"""The largest size of a vertex and of a face in bytes. STL repeats vertices in its faces; 3MF counts before
compression."""


async def exported(
    container: Container, collection: CollectionNumber, shape: ShapeRecord, format: str
) -> bytes:
    """The mesh of a shape in another file format; `core.io.write_mesh` lists what is preserved.

    Raises
    ------
    MeshTooComplexError
        The file could exceed the limit of an upload.
    NonFiniteCoordinatesError
        A coordinate is too large for the 32 bits of the format.
    """

    def read() -> bytes:
        with container.database.read() as session:
            return get_file(session, collection, shape.id)

    mesh = await container.queue.read(await run_in_threadpool(read), shape.format)
    check_size(mesh, format, container.settings.max_upload_bytes)
    return await container.queue.do(write_mesh, mesh, format)


def check_size(mesh: Mesh, format: str, limit: int) -> None:
    """Raise MeshTooComplexError if the file of a mesh could exceed the limit."""
    size = len(mesh.vertices) * _VERTEX[format] + len(mesh.faces) * _FACE[format]
    if size > limit:
        raise MeshTooComplexError(
            f"the mesh may take {size} bytes as {format.upper()}; at most {limit} bytes are written"
        )
