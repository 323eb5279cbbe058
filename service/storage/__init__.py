"""The database: an address in; sessions, tables, migrations, backups and checks out."""

__all__ = [
    "archive_file",
    "backup",
    "checking",
    "checksums",
    "columns",
    "copying",
    "database",
    "erasure",
    "hnsw",
    "migrate",
    "sqlite",
    "tables",
]
