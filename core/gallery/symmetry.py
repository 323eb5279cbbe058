"""Symmetries of the bodies of each class at rest.

At rest a creature looks along x, y is its left and z is up. A hand and pliers stand upright, so that x is
across the palm and the flat of the jaws. Deviations from the listed symmetries (the eyes of an octopus, the
position of a thumb) are smaller than the thickness of the limbs.
"""

from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Floats, Ints
from core.gallery.frames import rotation

_SIDES = np.diag([1.0, -1.0, 1.0])
_FLAT = np.diag([-1.0, 1.0, 1.0])
_UPSIDE = np.diag([1.0, 1.0, -1.0])
_ARMS = 8

_OCTOPUS = [
    rotation("z", 360.0 / _ARMS * turn) @ mirror
    for turn, mirror in product(range(_ARMS), (np.eye(3), _SIDES))
]

_BOTH = {
    "hand": [np.eye(3), _FLAT],
    "octopus": _OCTOPUS,
    "pliers": [np.eye(3), _SIDES, _FLAT, _FLAT @ _SIDES],
    "snake": [np.eye(3), _SIDES, _UPSIDE, _UPSIDE @ _SIDES],
}


def symmetries(label: str) -> Floats:
    """Orthogonal maps of a body at rest onto itself, the identity first, shape (g, 3, 3).

    Left and right for every class but the hand, whose palm and back are alike; pliers are alike from both
    faces too, a snake from above and below, and an octopus from each of its eight arms.
    """
    return np.array(_BOTH.get(label, [np.eye(3), _SIDES]))


def symmetric_partners(label: str, vertices: Floats, rest: Floats) -> Ints:
    """The vertex of a body at rest nearest to each point's image under each symmetry.

    Parameters
    ----------
    label : str
    vertices : float64, shape (n, 3)
        Vertices of a mesh of the same body at rest, this one or another.
    rest : float64, shape (m, 3)

    Returns
    -------
    int64, shape (g, n)
        One row for each symmetry; the first row belongs to the identity.
    """
    tree = cKDTree(rest)
    return np.array([tree.query(vertices @ turn.T)[1] for turn in symmetries(label)], dtype=np.int64)
