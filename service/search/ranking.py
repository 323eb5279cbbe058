"""The order of the shapes that were compared."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.search.rank_by import RankBy


@dataclass(frozen=True, eq=False)
class Compared:
    """The shapes that a query was compared with: arrays of shape (c,).

    Attributes
    ----------
    shapes : int64
        Their numbers.
    cc, ssd, sim : float64
        How alike each is to the query; `ssd` is less for what is more alike, the others greater.
    combined : float64 or None
        Likewise, where shapes are ranked by it.
    """

    shapes: NDArray[np.int64]
    cc: NDArray[np.float64]
    ssd: NDArray[np.float64]
    sim: NDArray[np.float64]
    combined: NDArray[np.float64] | None = None


def ranked(compared: Compared, by: RankBy) -> NDArray[np.intp]:
    """Places in `compared`, the most alike first; of equals, the least SSD, then the one stored first.

    Near copies, as two scans of one part, can have the CC and sim of the very same shape: SSD tells them.
    """
    likeness = -compared.ssd if by == "ssd" else getattr(compared, by)
    return np.lexsort((compared.shapes, compared.ssd, -likeness))
