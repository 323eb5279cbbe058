"""Numerical helpers: compilation of loops, radix sort, control of threads.

Functions and sort keys in; compiled functions and sort orders out.
"""

__all__ = ["compilation", "radix_sort", "threads"]
