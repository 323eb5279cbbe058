"""ShapeDNA: the Laplace-Beltrami spectrum as a description of shape, computed and compared by LaPy.

M. Reuter, F.-E. Wolter, N. Peinecke, "Laplace-Beltrami spectra as Shape-DNA of surfaces and solids",
Computer-Aided Design 38, 2006.
"""

from collections.abc import Sequence

import numpy as np
from lapy import Solver, TriaMesh
from lapy.shapedna import compute_distance, reweight_ev
from numpy.typing import NDArray

from core.mesh.cleaning import clean, face_areas
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import normal_frame

Floats = NDArray[np.float64]

VALUES = 15
"""Number of nonzero eigenvalues."""


def describe(mesh: Mesh) -> Floats:
    """Eigenvalues by linear finite elements, times the area, each divided by its rank: shape (VALUES,).

    The first, 0, is left out. The mesh is cleaned (LaPy wants no face without area) and brought to unit scale
    (its solver's shift is a fixed number).
    """
    cleaned = clean(mesh).mesh
    surface = TriaMesh(normal_frame(cleaned).apply(cleaned.vertices), cleaned.faces)
    values, _ = Solver(surface).eigs(k=VALUES + 1, rng=0)
    # LaPy computes the area from edge lengths, which gives NaN for slivers by rounding.
    area = float(face_areas(surface.v, surface.t).sum())
    return np.asarray(reweight_ev(area * values[1:]))


def compare(description: Floats, others: Sequence[Floats]) -> Floats:
    """Euclidean distances between spectra, shape (c,)."""
    return np.array([compute_distance(description, other) for other in others])
