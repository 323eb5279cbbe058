"""Compiled loops, sorting and threads.

Functions and integer keys in, the same functions compiled and an order out.
"""

__all__ = ["compilation", "radix_sort", "threads"]
