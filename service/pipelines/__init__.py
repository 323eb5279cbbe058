"""The pipeline that the archive is searched by: the database and the settings in, the active pipeline out."""

__all__ = ["active", "repository"]
