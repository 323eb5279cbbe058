"""Descriptors of a surface that need no correspondence.

A mesh in; spin images, views, global descriptors, the boundary ratio and the distances between descriptors
out.
"""

__all__ = [
    "boundary_ratio",
    "completeness",
    "descriptor_distance",
    "facts",
    "global_descriptors",
    "partial_matching",
    "reliability",
    "spin_images",
    "view_bytes",
    "view_descriptor",
    "view_signature",
]
