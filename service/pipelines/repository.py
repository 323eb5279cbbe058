"""The SQL of pipelines: the active one, and the embeddings of each."""

from contextlib import suppress

from sqlalchemy import delete, func, select, update
from sqlalchemy.orm import aliased

from core.errors import ParameterError
from core.parameters import METHOD_VERSION, Parameters
from service.errors import PipelineUnavailableError
from service.index.repository import OF_SHAPE
from service.storage.checksums import pipeline_checksum
from service.storage.database import ReadSession, WriteSession, next_revision
from service.storage.in_place import stored_bytes
from service.storage.tables import (
    NOT_DELETED,
    ArchiveRow,
    BlobRow,
    DuplicatePairRow,
    EmbeddingRow,
    JudgedShapeRow,
    NeighboursRow,
    PipelineRow,
    ShapeRow,
)

REMEDY = "run `isoshape reembed` on the archive"


def active(session: ReadSession) -> str | None:
    """Return the fingerprint of the active pipeline; None before the first start."""
    return session.scalars(select(ArchiveRow.fingerprint)).one()


def is_empty(session: ReadSession) -> bool:
    """Return whether the archive has no shape."""
    return session.scalar(select(ShapeRow.number).where(NOT_DELETED).limit(1)) is None


def parameters(session: ReadSession, fingerprint: str) -> Parameters:
    """Return the parameters of a stored pipeline.

    Raise PipelineUnavailableError if this version of the service does not have the pipeline.
    """
    row = session.get(PipelineRow, fingerprint)
    if row is None:
        raise PipelineUnavailableError(
            f"the archive was embedded by pipeline {fingerprint}, whose parameters it does not hold: {REMEDY}"
        )
    if row.method != METHOD_VERSION:
        raise PipelineUnavailableError(
            f"the archive was embedded by version {row.method} of the method, and this Isoshape has "
            f"version {METHOD_VERSION}: use the Isoshape that embedded it, or {REMEDY}"
        )
    with suppress(ParameterError):
        stored = Parameters.from_values(row.parameters)
        if stored.fingerprint == fingerprint:
            return stored
    raise PipelineUnavailableError(
        "the archive was embedded with parameters that this Isoshape does not have: use the Isoshape "
        f"that embedded it, or {REMEDY}"
    )


def keep(session: WriteSession, parameters: Parameters) -> None:
    """Store the parameters of a pipeline unless the archive holds them."""
    fingerprint = parameters.fingerprint
    if session.get(PipelineRow, fingerprint) is None:
        values = parameters.model_dump(mode="json")
        checksum = pipeline_checksum(fingerprint, METHOD_VERSION, values)
        session.add(
            PipelineRow(fingerprint=fingerprint, method=METHOD_VERSION, parameters=values, checksum=checksum)
        )
        session.flush()


def activate(session: WriteSession, fingerprint: str) -> None:
    """Make a pipeline the active one; every process then reads every shape again."""
    session.execute(update(ArchiveRow).values(fingerprint=fingerprint))
    session.execute(update(ShapeRow).values(revision=next_revision(session)))


def count_embedded(session: ReadSession, fingerprint: str) -> tuple[int, int]:
    """Return the numbers of files that a pipeline has embedded, and of all files; equal bytes count once."""
    files = select(ShapeRow.blob_number, ShapeRow.format).where(NOT_DELETED).distinct().subquery()
    total = session.scalar(select(func.count()).select_from(files)) or 0
    return total - len(unembedded(session, fingerprint)), total


def unembedded(session: ReadSession, fingerprint: str) -> list[tuple[int, str]]:
    """Return the files that a pipeline has not embedded, oldest first, as pairs of blob number and format."""
    query = (
        select(ShapeRow.blob_number, ShapeRow.format)
        .outerjoin(EmbeddingRow, OF_SHAPE & (EmbeddingRow.fingerprint == fingerprint))
        .where(EmbeddingRow.number.is_(None), NOT_DELETED)
        .distinct()
        .order_by(ShapeRow.blob_number, ShapeRow.format)
    )
    return [(number, format) for number, format in session.execute(query)]


def blob(session: ReadSession, number: int) -> tuple[str, bytes] | None:
    """Return the SHA-256 and the bytes of a blob, or None if it was deleted.

    Raise BadRecordError if the bytes are damaged.
    """
    row = session.execute(select(BlobRow.sha256, BlobRow.data).where(BlobRow.number == number)).one_or_none()
    return None if row is None else (row.sha256, stored_bytes(session, row.data, row.sha256))


def names(session: ReadSession, blob_number: int, format: str) -> list[str]:
    """Return the names of the shapes with a file."""
    query = select(ShapeRow.name).where(
        ShapeRow.blob_number == blob_number, ShapeRow.format == format, NOT_DELETED
    )
    return list(session.scalars(query.order_by(ShapeRow.number)))


def prune(session: WriteSession, kept: str, limit: int) -> int:
    """Delete at most `limit` embeddings by other pipelines of files that one pipeline has embedded; how many.

    Files that it has not embedded keep their embeddings: every shape has one. At the end, judgements of
    near-identical shapes, and neighbours, by the other pipelines are deleted too.
    """
    newer = aliased(EmbeddingRow)
    replaced = (
        select(EmbeddingRow.number)
        .join(
            newer,
            (newer.blob_number == EmbeddingRow.blob_number)
            & (newer.format == EmbeddingRow.format)
            & (newer.fingerprint == kept),
        )
        .where(EmbeddingRow.fingerprint != kept)
        .limit(limit)
    )
    numbers = session.scalars(replaced).all()
    session.execute(delete(EmbeddingRow).where(EmbeddingRow.number.in_(numbers)))
    if not numbers:
        for table in (DuplicatePairRow, JudgedShapeRow, NeighboursRow):
            session.execute(delete(table).where(table.fingerprint != kept))
        used = select(EmbeddingRow.fingerprint).distinct()
        session.execute(
            delete(PipelineRow).where(PipelineRow.fingerprint != kept, PipelineRow.fingerprint.not_in(used))
        )
    return len(numbers)
