"""The count of changes of what is searched."""

from sqlalchemy import update

from service.storage.database import WriteSession
from service.storage.tables import (
    ArchiveRow,
)


def next_revision(session: WriteSession) -> int:
    """Count a change of what is searched: once a transaction, since nobody sees a part of one."""
    if session.revision is None:
        counted = update(ArchiveRow).values(revision=ArchiveRow.revision + 1).returning(ArchiveRow.revision)
        session.revision = session.scalars(counted).one()
    return session.revision
