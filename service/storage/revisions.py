"""The revision of the archive, which counts changes of searchable data."""

from sqlalchemy import update

from service.storage.database import WriteSession
from service.storage.tables import (
    ArchiveRow,
)


def next_revision(session: WriteSession) -> int:
    """Increase the revision, once per transaction: nobody sees a part of one."""
    if session.revision is None:
        counted = update(ArchiveRow).values(revision=ArchiveRow.revision + 1).returning(ArchiveRow.revision)
        session.revision = session.scalars(counted).one()
    return session.revision
