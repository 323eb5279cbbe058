"""Descriptors of a surface that need no correspondence.

A mesh in; spin images, views, global descriptors, the boundary ratio and the distances between descriptors
out.
"""

__all__ = [
    "eigenvalues",
    "facts",
    "network",
    "network_views",
    "partial",
    "pieces",
    "registry",
    "spin_images",
    "view_images",
    "views",
]
