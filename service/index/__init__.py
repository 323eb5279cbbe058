"""Stored shapes in memory: database rows in, signatures and cached match records out."""

__all__ = ["cache", "repository", "signature_table"]
