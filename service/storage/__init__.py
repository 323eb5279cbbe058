"""The database: an address in; sessions, tables, migrations, backups and checks out."""

__all__ = [
    "backup",
    "checking",
    "checksums",
    "columns",
    "copying",
    "database",
    "duplicate_tables",
    "hnsw",
    "hnsw_parameters",
    "job_states",
    "job_tables",
    "lock",
    "migrate",
    "revisions",
    "sqlite",
    "tables",
]
