"""The SQL of pipelines: which is in use, and what each has embedded."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import delete, func, select, update
from sqlalchemy.orm import aliased

from service.storage.database import ReadSession, WriteSession
from service.storage.revisions import next_revision
from service.storage.tables import ArchiveRow, BlobRow, EmbeddingRow, PipelineRow, ShapeRow


@dataclass(frozen=True)
class Written:
    """A pipeline as the database tells of it."""

    method: int
    parameters: Mapping[str, Any]


def active(session: ReadSession) -> str | None:
    """The fingerprint of the pipeline that the archive is searched by; None before the first start."""
    return session.scalars(select(ArchiveRow.fingerprint)).one()


def is_empty(session: ReadSession) -> bool:
    """Whether no shape is stored."""
    return session.scalar(select(ShapeRow.number).limit(1)) is None


def written(session: ReadSession, fingerprint: str) -> Written | None:
    """What is known of a pipeline; nothing of one that only 0.1.0 has used."""
    row = session.get(PipelineRow, fingerprint)
    return None if row is None else Written(row.method, row.parameters)


def write(session: WriteSession, fingerprint: str, pipeline: Written) -> None:
    """Keep what a pipeline is, unless it is known."""
    if session.get(PipelineRow, fingerprint) is None:
        session.add(
            PipelineRow(fingerprint=fingerprint, method=pipeline.method, parameters=dict(pipeline.parameters))
        )
        session.flush()


def activate(session: WriteSession, fingerprint: str) -> None:
    """Have the archive searched by a pipeline, and every shape looked at again by every process."""
    session.execute(update(ArchiveRow).values(fingerprint=fingerprint))
    session.execute(update(ShapeRow).values(revision=next_revision(session)))


def count_embedded(session: ReadSession, fingerprint: str) -> tuple[int, int]:
    """How many files a pipeline has embedded, and how many there are; once for shapes on the same bytes."""
    files = select(ShapeRow.blob_number, ShapeRow.format).distinct().subquery()
    total = session.scalar(select(func.count()).select_from(files)) or 0
    return total - len(unembedded(session, fingerprint)), total


def unembedded(session: ReadSession, fingerprint: str) -> list[tuple[int, str]]:
    """The files that a pipeline has not embedded, oldest first: number of the blob, and format."""
    query = (
        select(ShapeRow.blob_number, ShapeRow.format)
        .outerjoin(
            EmbeddingRow,
            (EmbeddingRow.blob_number == ShapeRow.blob_number)
            & (EmbeddingRow.format == ShapeRow.format)
            & (EmbeddingRow.fingerprint == fingerprint),
        )
        .where(EmbeddingRow.number.is_(None))
        .distinct()
        .order_by(ShapeRow.blob_number, ShapeRow.format)
    )
    return [(number, format) for number, format in session.execute(query)]


def blob(session: ReadSession, number: int) -> tuple[str, bytes] | None:
    """SHA-256 and bytes of a blob, if it is still there."""
    row = session.execute(select(BlobRow.sha256, BlobRow.data).where(BlobRow.number == number)).one_or_none()
    return None if row is None else (row[0], row[1])


def names(session: ReadSession, blob_number: int, format: str) -> list[str]:
    """What the shapes on a file are called."""
    query = select(ShapeRow.name).where(ShapeRow.blob_number == blob_number, ShapeRow.format == format)
    return list(session.scalars(query.order_by(ShapeRow.number)))


def prune(session: WriteSession, kept: str, limit: int) -> int:
    """Delete some of the embeddings of files that one pipeline has embedded too; how many.

    What it has not embedded keeps what it has: an archive has no shape without an embedding.
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
        used = select(EmbeddingRow.fingerprint).distinct()
        session.execute(
            delete(PipelineRow).where(PipelineRow.fingerprint != kept, PipelineRow.fingerprint.not_in(used))
        )
    return len(numbers)
