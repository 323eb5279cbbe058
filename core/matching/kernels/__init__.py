"""The compiled loops of matching, each beside a plain reference that it is tested against.

They call one another across files. The compiler's cache on disk follows a function's own file only, so the
name that it caches under carries a hash of all these sources (`core.numerics.compilation.kernel`).
"""

__all__ = [
    "match_record",
    "matrix_product",
    "nearest_neighbours",
    "one_to_many",
    "orthogonal_procrustes",
    "pair_matching",
    "reranking",
    "sign_starts",
    "spline_search",
]
