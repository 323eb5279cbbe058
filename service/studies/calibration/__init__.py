"""The calibration of `combined`.

Scores of labelled pairs in, a fitted model, a picture and a page out.
"""

__all__ = ["figure", "page", "part_pairs", "study"]
