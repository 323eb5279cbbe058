"""The tables of an empty database, and the migration of an older archive to the version of this code."""

from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, insert, text

from service.collection import DEFAULT_COLLECTION
from service.errors import ArchiveTooNewError
from service.storage.columns import POSTGRESQL
from service.storage.database import Database
from service.storage.postgresql import check_server
from service.storage.tables import ArchiveRow, CollectionRow, Table

_FOLDER = Path(__file__).parent / "migrations"


def migrate(database: Database) -> None:
    """Create the tables of an empty database, or run all missing migrations, in one transaction.

    Raises
    ------
    ArchiveError
        A newer version of the service wrote the database, or the database server does not meet the
        requirements of an archive.
    """
    config = _config()
    with database.connect() as connection:
        if connection.dialect.name == POSTGRESQL:
            check_server(connection)
        versions = MigrationContext.configure(connection).get_current_heads()
        check_known(versions)
        config.attributes["connection"] = connection
        if versions:
            command.upgrade(config, "head")
        else:
            _create(connection)
            command.stamp(config, "head")


def _create(connection: Connection) -> None:
    """Create the tables, and insert the rows that every archive has."""
    if connection.dialect.name == POSTGRESQL:
        connection.execute(text("CREATE EXTENSION IF NOT EXISTS vector"))
    Table.metadata.create_all(connection, checkfirst=False)
    connection.execute(insert(ArchiveRow).values(number=1, revision=0))
    # The database generates the number, so that it never gives the number again.
    connection.execute(
        insert(CollectionRow).values(name=DEFAULT_COLLECTION.name, created_at=datetime.now(UTC))
    )


def check_known(versions: Iterable[str]) -> None:
    """Raise unless this code knows all versions that a database has.

    Raises
    ------
    ArchiveTooNewError
    """
    known = {script.revision for script in ScriptDirectory.from_config(_config()).walk_revisions()}
    unknown = sorted(set(versions) - known)
    if unknown:
        raise ArchiveTooNewError(
            f"the database has version {', '.join(unknown)}, which this Isoshape does not know: a newer one "
            f"wrote it. Use that one, or restore a backup that this one wrote."
        )


def _config() -> Config:
    config = Config()
    # Alembic expands percent signs in the value, so that they are doubled.
    config.set_main_option("script_location", str(_FOLDER).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    return config
