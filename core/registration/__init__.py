"""Registration of two surfaces by a similarity transform.

Two sampled surfaces in; the best similarity transform of one onto the other and its residual out.
"""

__all__ = [
    "instances",
    "invariants",
    "probed_surface",
    "rigid_alignment",
    "rigid_copy",
    "similarity",
    "surface_distances",
]
