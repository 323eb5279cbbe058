"""A layout of the graph of neighbours on a plane: links pull shapes together, and all shapes push each other.

The forces are those of UMAP (L. McInnes, J. Healy, J. Melville, 2018) with the kernel 1 / (1 + d^2), and the
pushes are sampled, so that a step costs time in proportion to the links.
"""

import numpy as np

from core.arrays import Floats, Ints
from core.ranking.diffusion import NOBODY, link_weights

STEPS = 100
PUSHES = 10
"""Pushes of a shape, at each step, by others that are drawn at random."""

LARGEST_STEP = 4.0
EXTENT = 10.0
"""Half of the extent of the positions at the start."""


def graph_positions(links: Ints, log_odds: Floats, start: Floats) -> Floats:
    """Return positions of n shapes, shape (n, 2); equal arguments give equal positions.

    `links` and `log_odds`, shape (n, k), are those of `core.ranking.diffusion.NeighbourRows.links`. The
    layout begins with the positions `start`, shape (n, 2), in any unit. They keep shapes apart that no chain
    of links joins.
    """
    count = len(start)
    random = np.random.default_rng(0)
    positions: Floats = start - start.mean(axis=0)
    positions *= EXTENT / (np.abs(positions).max(initial=0.0) or 1.0)
    # Equal positions would never part.
    positions += 1e-3 * random.standard_normal(positions.shape)
    sources, columns = np.nonzero(links != NOBODY)
    targets, weights = links[sources, columns], link_weights(log_odds)[sources, columns]
    for step in range(STEPS):
        forces = np.zeros((count, 2))
        between = positions[targets] - positions[sources]
        pulls = between * (2.0 * weights / (1.0 + (between**2).sum(axis=1)))[:, None]
        _add(forces, sources, pulls)
        _add(forces, targets, -pulls)
        pushed = np.repeat(np.arange(count), PUSHES)
        others = random.integers(0, count, len(pushed))
        between = positions[pushed] - positions[others]
        squares = (between**2).sum(axis=1)
        _add(forces, pushed, between * (2.0 / ((1e-3 + squares) * (1.0 + squares)))[:, None])
        rate = 1.0 - step / STEPS
        positions += rate * np.clip(forces, -LARGEST_STEP, LARGEST_STEP)
    return positions


def _add(forces: Floats, shapes: Ints, added: Floats) -> None:
    """Add forces on shapes, shape (m, 2), of which a shape may have several."""
    for axis in (0, 1):
        forces[:, axis] += np.bincount(shapes, added[:, axis], len(forces))
