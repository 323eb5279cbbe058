"""The compiled loops of matching.

They call one another across files. The compiler's cache on disk follows a function's own file only, so the
name that it caches under carries a hash of all these sources (`core.numerics.compilation.kernel`). A function
is compiled again in each function that calls it, and once more for each layout, constant or literal among its
arguments: long functions with one caller stay whole, and all arrays are C-contiguous and writable but for
constants of a module.
"""

__all__ = [
    "match_record",
    "nearest_neighbours",
    "one_to_many",
    "pair_matching",
    "points",
    "procrustes",
    "simd",
    "spline_search",
]
