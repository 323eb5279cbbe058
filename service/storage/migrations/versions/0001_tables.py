"""The tables of `service.storage.tables`, which `service.storage.database` creates in an empty database."""

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Change nothing: this is the oldest version of an archive."""
