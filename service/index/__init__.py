"""Stored shapes in memory: database rows in, signatures and cached match records out."""

__all__ = ["cache", "neighbour_repository", "repository", "signature_table"]
