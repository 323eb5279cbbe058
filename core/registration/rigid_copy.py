"""Whether one surface is a rigid copy of another, and its scale, in some milliseconds.

Copies with one tessellation have the same samples in the same order, so their records suffice. Other copies
are registered by ICP from the correspondence and the principal axes, without reflections.
"""

from itertools import product

import numpy as np

from core.arrays import Floats
from core.embedding import Embedding
from core.registration.similarity_icp import (
    RESIDUAL,
    Similarity,
    best_similarity,
    closest_pairs,
    rough_alignment,
)
from core.sampling.surface_samples import SurfaceSamples

COPY_SPECTRAL = 0.05
"""Largest spectral distance of two rigid copies; another mesh of a surface moves the eigenvalues. Copies with
half of the vertices have at most 0.005, thin wings on a coarse mesh 0.039."""

STARTING, ROUNDS = 6, 5
"""Largest numbers of coarse iterations from each initial alignment, and of fine iterations."""

STRAIGHT, PROMISING, FINE, HOPELESS = 0.01, 0.02, 0.0015, 3.0 * RESIDUAL
"""A coarse alignment with a residual of at most `STRAIGHT`, about the spacing of the sample points, ends the
search for initial alignments; one above `PROMISING` is no copy. Fine iterations end at `FINE`,
or without a copy above `HOPELESS`."""


def may_be_copy(spectral: float, first_radius: float, second_radius: float) -> bool:
    """Whether eigenvalues and area allow that two surfaces are rigid copies.

    Parameters
    ----------
    spectral : float
        Distance of their log eigenvalues, >= 0.
    first_radius, second_radius : float
        Root mean square distance of each surface from its centroid over the square root of its area. Those of
        two surfaces differ by at most their residual.
    """
    return spectral <= COPY_SPECTRAL and abs(first_radius - second_radius) <= RESIDUAL


def scale_by_samples(first: Embedding, second: Embedding) -> float | None:
    """Length in the second surface over length in the first, by the samples of two embeddings.

    None unless the samples coincide, in their order, after a rotation and a scaling: surfaces with other
    tessellations have other samples.
    """
    if len(first.positions) != len(second.positions):
        return None
    source, target = (one.positions.astype(np.float64) for one in (first, second))
    motion = best_similarity(source, target, sign=1, scaled=True)
    gaps = np.linalg.norm(target - motion.apply(source), axis=1)
    return motion.scale if gaps.max() <= RESIDUAL * np.sqrt(second.facts.area) else None


def scale_by_surfaces(
    first: SurfaceSamples, second: SurfaceSamples, pairs: tuple[Floats, Floats]
) -> float | None:
    """Length in the second surface over length in the first, by registration; None if they are no copies.

    Parameters
    ----------
    first, second : SurfaceSamples
    pairs : two of float64, shape (m, 3)
        Corresponding points of both surfaces, in the files' units: the first initial alignment. The principal
        axes give four more.
    """
    motion = _initial(first, second, pairs)
    if motion is None:
        return None
    residual, ours, theirs = closest_pairs(first, second, motion)
    for _ in range(ROUNDS):
        if residual > HOPELESS:
            return None
        motion = best_similarity(ours, theirs, sign=1, scaled=True)
        residual, ours, theirs = closest_pairs(first, second, motion)
        if residual <= FINE:
            break
    return motion.scale * second.unit / first.unit if residual <= RESIDUAL else None


def _initial(
    first: SurfaceSamples, second: SurfaceSamples, pairs: tuple[Floats, Floats]
) -> Similarity | None:
    """The coarse alignment of least residual, or the first that is near enough; None if none promises."""
    starts = [
        best_similarity(first.to_unit(pairs[0]), second.to_unit(pairs[1]), sign=1, scaled=False),
        *(
            Similarity(1.0, second.axes.T * signs @ first.axes, np.zeros(3))
            for signs in product((1.0, -1.0), repeat=3)
            if np.prod(signs) > 0.0
        ),
    ]
    best, chosen = PROMISING, None
    for start in starts:
        residual, motion = rough_alignment(first, second, start, 1, STARTING)
        if residual <= best:
            best, chosen = residual, motion
        if residual <= STRAIGHT:
            break
    return chosen
