"""Triangle meshes: validity, cleaning, hole filling, denoising, simplification, subdivision, frames.

Vertices and faces in; a clean, closed and evenly meshed surface in its normal frame out.
"""

__all__ = [
    "bounding_box",
    "box_tree",
    "cleaning",
    "edges",
    "mesh",
    "normal_frame",
    "ordering",
    "preparation",
    "simplification",
    "subdivision",
]
