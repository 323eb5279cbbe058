"""Numerical helpers: compilation of loops, radix sort, factors of matrices, control of threads and faults.

Functions, sort keys and matrices in; compiled functions, sort orders and solutions out.
"""

__all__ = ["compilation", "guarding", "radix_sort", "symmetric_factor", "threads", "triangular_solve"]
