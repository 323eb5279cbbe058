"""Migration of a database to the version of this code."""

from collections.abc import Iterable
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory

from service.errors import ArchiveTooNewError
from service.storage.columns import POSTGRESQL
from service.storage.database import Database
from service.storage.postgresql import check_server

_FOLDER = Path(__file__).parent / "migrations"


def migrate(database: Database) -> None:
    """Run all missing migrations in one transaction.

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
        check_known(MigrationContext.configure(connection).get_current_heads())
        config.attributes["connection"] = connection
        command.upgrade(config, "head")


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
