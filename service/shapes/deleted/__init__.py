"""Deleted shapes, kept for some days: ids in, restored records out."""

__all__ = ["endpoints", "schemas", "service"]
