"""Descriptors of a surface beside its spectrum.

A mesh in, spin images, global descriptors and boundary ratio out, and their distances.
"""

__all__ = [
    "boundary_ratio",
    "completeness",
    "descriptor_distance",
    "global_descriptors",
    "partial_matching",
    "spin_images",
]
