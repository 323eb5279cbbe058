"""Triangle meshes: validity, cleaning, hole filling, denoising, simplification, subdivision, normal frame.

Vertices and faces in; a clean, closed and evenly meshed surface in its normal frame out.
"""

__all__ = [
    "boundary",
    "bounding_box",
    "cleaning",
    "denoising",
    "edge_contraction",
    "edges",
    "face_normals",
    "hole_filling",
    "mesh",
    "nearest_vertices",
    "normal_frame",
    "ordering",
    "preparation",
    "simplification",
    "subdivision",
]
