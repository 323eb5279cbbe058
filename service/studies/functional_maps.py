"""Vertex-to-vertex maps by pyfmaps, to compare with our dense correspondence."""

from typing import Any

import numpy as np

from core.arrays import Ints
from core.mesh.mesh import Mesh

SPECTRUM = 200
"""Number of eigenvalues that pyfmaps computes by default."""

ORIENTATION_WEIGHT = 0.1
"""Weight of the orientation term where it is used; the other weights are the library's defaults."""


def spectrum(mesh: Mesh) -> Any:  # noqa: ANN401  the library's own
    """The eigenfunctions of a mesh, of the robust Laplacian.

    Raises
    ------
    ImportError
        Pyfmaps is not installed.
    """
    from pyFM.mesh import TriMesh  # noqa: PLC0415  optional

    surface = TriMesh(mesh.vertices.copy(), mesh.faces.copy(), area_normalize=True, center=True)
    return surface.process(SPECTRUM, robust=True)


def functional_map(first: Any, second: Any, *, oriented: bool) -> Ints:  # noqa: ANN401  the library's own
    """The vertex of the second mesh for each vertex of the first, int64, shape (n,).

    The map is fitted to wave kernel signatures and refined by ZoomOut, with the library's default options.

    Parameters
    ----------
    first, second : object
        From `spectrum`.
    oriented : bool
        Whether the fit has the term that preserves orientation.
    """
    from pyFM.functional import FunctionalMapping  # noqa: PLC0415  optional

    model = FunctionalMapping(second, first)
    model.preprocess(k_process=SPECTRUM)
    model.fit(w_orient=ORIENTATION_WEIGHT if oriented else 0)
    model.zoomout_refine()
    return np.asarray(model.get_p2p(), dtype=np.int64)
