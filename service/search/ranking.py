"""The order of an answer's shapes, by one of their scores."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.search.rank_by import RankBy


@dataclass(frozen=True, eq=False)
class Compared:
    """The scores of c shapes that a query was compared with; each array has shape (c,).

    Attributes
    ----------
    shapes : int64
        Numbers of the shapes.
    cc, ssd, sim : float64
        Scores of each shape and the query, see `core.matching`. Similar shapes have a small `ssd`, and large
        `cc` and `sim`.
    combined : float64 or None
        Class score (`service.search.class_probability`), if the answer is ranked by it.
    """

    shapes: NDArray[np.int64]
    cc: NDArray[np.float64]
    ssd: NDArray[np.float64]
    sim: NDArray[np.float64]
    combined: NDArray[np.float64] | None = None


def ranked(compared: Compared, by: RankBy) -> NDArray[np.intp]:
    """Indices into `compared`, the most similar shape first; ties by ascending SSD, then by number.

    Near copies, such as two scans of one part, can have the CC and sim of the shape itself; their SSD
    differs.
    """
    score = -compared.ssd if by == "ssd" else getattr(compared, by)
    return np.lexsort((compared.shapes, compared.ssd, -score))
