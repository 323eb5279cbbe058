"""The dense correspondence of two shapes, as it is seen from one of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Int32s


@dataclass(frozen=True, eq=False)
class DenseCorrespondence:
    """For each of the n vertices of one mesh its vertex on another mesh, and how the two differ there.

    Attributes
    ----------
    vertices : int32, shape (n,)
        A vertex of the other mesh, as it was given; several vertices may share one.
    confidence : float32, shape (n,)
        How far the vertex can be trusted, in [0, 1]: 0 where there is no partner.
    stretch : float32, shape (n,)
        Length around the vertex on the other mesh over length here, > 0, divided by its median: 1 where
        the surface is not stretched.
    displacement : float32, shape (n,), or None
        Distance from the partner after the best similarity transform, in units of this mesh; where there is
        no partner, the distance from the other surface. None unless the two are rigid copies in large part.
    partnered : bool, shape (n,)
        Whether the other surface has a corresponding place.
    scale : float
        Length on the other mesh over length on this mesh, > 0.
    simplified : bool
        Whether the correspondence was computed on simplified copies of the two meshes and transferred.
    """

    vertices: Int32s
    confidence: Float32s
    stretch: Float32s
    displacement: Float32s | None
    partnered: NDArray[np.bool_]
    scale: float
    simplified: bool
