"""Numerical helpers: compilation of loops, radix sort, control of threads and faults.

Functions and sort keys in; compiled functions and sort orders out.
"""

__all__ = ["compilation", "guarding", "radix_sort"]
