"""Spectral embedding (section 3.3).

A mesh and the distances to its samples in; eigenvalues, spectral coordinates and the signature out.
"""

__all__ = ["lanczos", "laplace_beltrami", "orientation", "spectral_embedding"]
