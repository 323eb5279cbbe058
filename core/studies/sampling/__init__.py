"""Quality of samples (section 3.2, Figs. 2 and 3).

A mesh in; samples by every method and their measures out.
"""

__all__ = ["measures", "robustness", "study", "surface", "trials"]
