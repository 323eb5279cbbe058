"""The tables of bulk jobs.

The database stores the uploaded archive in pieces: one commit makes it durable, backups contain it, and any
service on the database can continue the job, also on another machine.
"""

from datetime import datetime
from typing import Any

from sqlalchemy import JSON, ForeignKey, Index, LargeBinary, String, Text
from sqlalchemy.orm import Mapped, mapped_column

from service.storage.checksums import LENGTH
from service.storage.columns import AnyText, UtcDateTime
from service.storage.tables import Table


class JobRow(Table):
    """A bulk job, which stores the members of an archive.

    `number` increases in the order of creation. `state` is one of `service.storage.job_states.State`.
    `runner` identifies the service that receives or runs the job; it counts as dead after `leased_until`.
    """

    __tablename__ = "jobs"
    __table_args__ = (
        Index("jobs_by_state", "state"),
        Index("jobs_by_collection", "collection_number", "number"),
        {"sqlite_autoincrement": True},
    )

    number: Mapped[int] = mapped_column(primary_key=True)
    id: Mapped[str] = mapped_column(AnyText(36), unique=True)
    collection_number: Mapped[int] = mapped_column(ForeignKey("collections.number"))
    state: Mapped[str] = mapped_column(String(16))
    archive: Mapped[str] = mapped_column(String(255))
    format: Mapped[str] = mapped_column(String(8))
    size: Mapped[int]
    tags: Mapped[list[str]] = mapped_column(JSON)
    meta: Mapped[dict[str, Any]] = mapped_column(JSON)
    kind: Mapped[str | None] = mapped_column(String(64))
    detail: Mapped[str | None] = mapped_column(Text)
    runner: Mapped[str | None] = mapped_column(String(36))
    leased_until: Mapped[datetime | None] = mapped_column(UtcDateTime)
    created_at: Mapped[datetime] = mapped_column(UtcDateTime)
    started_at: Mapped[datetime | None] = mapped_column(UtcDateTime)
    ended_at: Mapped[datetime | None] = mapped_column(UtcDateTime)


class JobPieceRow(Table):
    """A piece of the archive of an unfinished job."""

    __tablename__ = "job_pieces"

    job_number: Mapped[int] = mapped_column(ForeignKey("jobs.number", ondelete="CASCADE"), primary_key=True)
    place: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    data: Mapped[bytes] = mapped_column(LargeBinary)
    checksum: Mapped[str | None] = mapped_column(String(LENGTH))


class JobFileRow(Table):
    """A member of a job's archive and its outcome, which is NULL until the member is processed."""

    __tablename__ = "job_files"
    __table_args__ = (Index("job_files_by_outcome", "job_number", "outcome", "place"),)

    job_number: Mapped[int] = mapped_column(ForeignKey("jobs.number", ondelete="CASCADE"), primary_key=True)
    place: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    path: Mapped[str] = mapped_column(String(1024))
    name: Mapped[str] = mapped_column(String(1024))
    outcome: Mapped[str | None] = mapped_column(String(16))
    shape_id: Mapped[str | None] = mapped_column(String(36))
    kind: Mapped[str | None] = mapped_column(String(64))
    detail: Mapped[str | None] = mapped_column(Text)
    ended_at: Mapped[datetime | None] = mapped_column(UtcDateTime)
