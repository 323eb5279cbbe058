"""Stored shapes in memory: database rows in, signatures and cached match records out."""

__all__ = [
    "cache",
    "density_samples",
    "repository",
    "signature_table",
    "surface_measurements",
]
