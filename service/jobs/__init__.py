"""Bulk jobs: an archive of meshes in, its members stored one by one and their outcomes out."""

__all__ = ["endpoints", "runner", "schemas", "zip_archive"]
