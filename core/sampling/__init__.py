"""Sampling of a surface (sections 3.1 and 3.2, Algorithm 1).

A mesh and its graph in; selected vertices or points out.
"""

__all__ = ["lewis_weights", "sampling", "surface_samples"]
