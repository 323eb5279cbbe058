"""Bring a database to the version of this code."""

from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory

from service.errors import ArchiveTooNewError
from service.storage.database import Database

_FOLDER = Path(__file__).parent / "migrations"


def migrate(database: Database) -> None:
    """Run the migrations that the database lacks, in one transaction.

    Raises
    ------
    ArchiveTooNewError
        A newer version of the service has changed the database in ways this one does not know.
    """
    config = Config()
    # Alembic reads the value as a template, in which a percent sign is doubled.
    config.set_main_option("script_location", str(_FOLDER).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    scripts = ScriptDirectory.from_config(config)
    known = {script.revision for script in scripts.walk_revisions()}
    with database.connect() as connection:
        present = MigrationContext.configure(connection).get_current_heads()
        unknown = sorted(set(present) - known)
        if unknown:
            raise ArchiveTooNewError(
                f"the database has version {', '.join(unknown)}, which this Isoshape does not know: it was "
                f"written by a newer one. Use that one, or restore a backup made before the upgrade."
            )
        config.attributes["connection"] = connection
        command.upgrade(config, "head")
