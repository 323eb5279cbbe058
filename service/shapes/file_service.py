"""The files and embeddings of shapes: read, export and replace them; headers of their downloads."""

import io
from typing import Any
from urllib.parse import quote

import numpy as np

from core.embedding import Embedding
from core.errors import MeshTooComplexError
from core.io import FORMATS, write_mesh
from core.mesh.mesh import Mesh
from service.collection import CollectionNumber
from service.container import Container
from service.errors import FileChangedError, NameTakenError
from service.shapes import file_repository, repository
from service.shapes.records import NewFile, ShapeRecord
from service.shapes.schemas import ARRAYS
from service.shapes.service import Put, get, store_files
from service.storage.database import ReadSession, WriteSession


async def exported(
    container: Container, collection: CollectionNumber, shape: ShapeRecord, format: str
) -> bytes:
    """Return the mesh of a shape in another file format; `core.io.write_mesh` lists what is preserved.

    Raises
    ------
    MeshTooComplexError
        The file could exceed the limit of an upload.
    NonFiniteCoordinatesError
        A coordinate is too large for the 32 bits of the format.
    """
    data = await container.database.reading(file_repository.file_of, collection, shape.id)
    mesh = await container.queue.read(data, shape.format)
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


async def replace_file(
    container: Container, collection: CollectionNumber, shape_id: str, file: NewFile, if_match: str | None
) -> ShapeRecord:
    """Replace the file of a shape; its id, name, tags and metadata stay.

    Stages: check the shape and If-Match; embed the file in a worker if needed; replace bytes, embedding and
    shape in one transaction. Every query sees either file, and the shape always has an embedding.

    Raises
    ------
    ShapeNotFoundError
        The collection has no such shape.
    FileChangedError
        If-Match names another file.
    NameTakenError
        Another shape of the collection has the same name and the new file.
    """

    def matching(session: ReadSession) -> ShapeRecord:
        record = get(session, collection, shape_id)
        tag = entity_tag(record.sha256)
        if if_match is not None and not is_known(if_match, tag):
            raise FileChangedError(f"the ETag of the file is now {tag}")
        return record

    def replace(session: WriteSession, put: Put) -> ShapeRecord:
        record = matching(session)
        if (record.sha256, record.format) != file.key:
            stored = put(file)
            if repository.same(session, collection, file, record.name) is not None:
                raise NameTakenError(f"another shape has this file and the name {record.name!r}")
            repository.replace_file(session, record, file.format, stored)
        return get(session, collection, shape_id)

    await container.database.reading(matching)
    return (await store_files(container, [file], replace))[0]


def as_npz(embedding: Embedding) -> bytes:
    """Return an embedding as a NumPy archive; names of spectral arrays begin with the spectrum's name."""
    arrays: dict[str, Any] = {name: getattr(embedding, name) for name in ARRAYS}
    for spectrum in embedding.spectra:
        arrays[f"{spectrum.name}_eigenvalues"] = spectrum.eigenvalues
        arrays[f"{spectrum.name}_coordinates"] = spectrum.coordinates
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def disposition(name: str, format: str) -> str:
    """Return a Content-Disposition that saves the file under the shape's name (RFC 6266).

    Old clients read `filename`, where an underscore replaces unsafe characters; newer ones read `filename*`,
    where unsafe bytes are percent-encoded.
    """
    if name.lower().rpartition(".")[2] not in FORMATS[format].endings:
        name = f"{name}.{format}"
    harmless = "".join(c if c.isascii() and (c.isalnum() or c in " .-_()") else "_" for c in name)
    return f"attachment; filename=\"{harmless}\"; filename*=UTF-8''{quote(name, safe='')}"


def entity_tag(sha256: str) -> str:
    """Return the ETag of bytes with a SHA-256."""
    return f'"{sha256}"'


def is_known(if_none_match: str | None, tag: str) -> bool:
    """Return whether an If-None-Match header contains the tag, or is `*`."""
    if if_none_match is None:
        return False
    given = [part.strip().removeprefix("W/") for part in if_none_match.split(",")]
    return "*" in given or tag in given
