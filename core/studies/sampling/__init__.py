"""How good samples are (section 3.2, Figs. 2 and 3).

A mesh in, samples by every method and their measures out.
"""

__all__ = ["evidence", "robustness", "study", "surface", "trials"]
