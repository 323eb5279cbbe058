"""The spectral embedding (section 3.3).

Distances between samples and a mesh in, eigenvalues and coordinates out.
"""

__all__ = ["laplace_beltrami", "spectral_embedding"]
