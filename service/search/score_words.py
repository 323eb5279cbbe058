"""Scores as text, with more digits near 1."""

import math

LEAST_DIGITS, MOST_DIGITS = 4, 7
"""Decimals of a score. The samples' coordinates have the precision of seven."""

CC_OF_PAIRS = (
    "Unlike shapes have a high cc too: 0.83 to 0.96 for 90 % of the pairs of two classes of SHREC'11, and "
    "0.968 to 0.999 for 90 % of the pairs of one class. From 0.98 an answer is matched."
)
"""How to read CC, as `isoshape evaluate` measured it (docs/likeness.md)."""


def score_in_words(score: float) -> str:
    """A score of at most 1 with the decimals that show two digits of its distance from 1.

    0.9712 has four decimals, 0.999987 six; 1 within half of the last decimal is 1.0000.
    """
    apart = abs(1.0 - score)
    if apart < 0.5 * 10.0**-MOST_DIGITS:
        return f"{1.0:.{LEAST_DIGITS}f}"
    digits = math.ceil(-math.log10(apart)) + 1
    return f"{score:.{min(max(digits, LEAST_DIGITS), MOST_DIGITS)}f}"
