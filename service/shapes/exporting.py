"""Export of stored meshes to other file formats."""

from starlette.concurrency import run_in_threadpool

from core.errors import MeshTooComplexError
from core.io import FORMATS, write_mesh
from core.mesh.mesh import Mesh
from service.collection import CollectionNumber
from service.container import Container
from service.shapes.records import ShapeRecord
from service.shapes.service import get_file


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
    written = FORMATS[format]
    size = len(mesh.vertices) * written.vertex_bytes + len(mesh.faces) * written.face_bytes
    if size > limit:
        raise MeshTooComplexError(
            f"the mesh may take {size} bytes as {written.title}; at most {limit} bytes are written"
        )
