"""The database: an address in; sessions, tables, migrations, backups and checks out."""

__all__ = [
    "backup",
    "checking",
    "checksums",
    "columns",
    "copying",
    "database",
    "hnsw",
    "hnsw_parameters",
    "job_states",
    "lock",
    "migrate",
    "revisions",
    "sqlite",
    "tables",
]
