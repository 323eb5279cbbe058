"""How far two surfaces are from isometric: poses of one body nearly are."""

import math

import numpy as np

from core.arrays import Floats
from core.embedding import Embedding
from core.ranking.shortlist import eigenvalue_steps
from core.registration.rigid_copy import proportions


def isometry_distance(first: Embedding, second: Embedding) -> float:
    """Return how far two surfaces are from isometric, >= 0: 0 for two ideal poses of one body.

    The volumes of open surfaces do not count. See `distance_of_steps`.
    """
    steps = eigenvalue_steps(first.signature, second.signature[None])[0]
    ours, theirs = (
        proportions(area=f.area, volume=f.volume, scale=f.scale, boundary_edges=f.boundary_edges).volume
        for f in (first.facts, second.facts)
    )
    return distance_of_steps(steps, 0.0 if ours is None or theirs is None else math.log(ours / theirs))


def distance_of_steps(steps: Floats, growth: float) -> float:
    """Return the isometry distance of two surfaces, >= 0.

    `steps`, shape (k,), are the differences of their log eigenvalues at unit area, each over the root of
    their number, and `growth` is the difference of the logarithms of their volumes at unit area. Bending
    moves eigenvalues up and down, whereas a factor common to all is one of proportions: its square counts
    five times. Bending nearly keeps the volume: half of its square counts.
    """
    common = steps.mean() ** 2 * len(steps)
    return float(np.sqrt(steps @ steps + 4.0 * common + 0.5 * growth**2))
