"""Triangle meshes.

Vertices and faces in; a valid, clean, closed, smooth, even mesh in its normal frame out.
"""

__all__ = [
    "cleaning",
    "denoising",
    "edges",
    "hole_filling",
    "mesh",
    "normal_frame",
    "ordering",
    "simplification",
    "subdivision",
]
