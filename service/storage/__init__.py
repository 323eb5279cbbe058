"""The database: an address in; sessions, tables, migrations, backups and checks out."""

__all__ = [
    "backup",
    "checking",
    "checksums",
    "columns",
    "copying",
    "database",
    "files",
    "in_place",
    "postgresql",
    "sqlite",
    "tables",
    "words",
]
