"""Retrieval with a perturbed query against a clean gallery (the paper's Fig. 9): what is tried, how measured.

Every shape in turn is perturbed and is the query; its own clean self is left out of the ranking.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats
from core.evaluation.retrieval_measures import evaluate
from core.mesh.mesh import Mesh
from core.mesh.simplification import decimate
from core.parameters import DEFAULT, Parameters
from core.studies.perturbation import add_noise, cut_part, make_soup, remove_discs, separate_parts, subdivide

TAU = "tau"
TAUS = (0.1, 0.2, 0.3, 0.4, 0.6, 0.8)

TAU_VERTICES = 600
"""Under a sparse ratio, meshes are simplified to about so many vertices, and those of fewer than `TAU_LEAST`
refined, so that tau = 0.8 is feasible: twice the samples take five times as long to match."""

TAU_LEAST = 500
"""So far below `TAU_VERTICES` that what was simplified is not refined again."""

TAU_CAP = 480
"""No more samples than these, which is tau = 0.8 of `TAU_VERTICES`; a few meshes stay finer."""


@dataclass(frozen=True)
class Kind:
    """One way to perturb a shape, by how much it is done.

    Attributes
    ----------
    name : str
    title : str
        What is done.
    unit : str
        What the amounts are, in per cent.
    perturb : callable
        From a mesh, an amount and a seed to a mesh.
    amounts : tuple of float
        In the order of the curve, the mildest first.
    certain : tuple of float
        Those of the amounts that leave nothing to chance: one seed tells all.
    part : bool
        What is left is a part of the shape: it is also looked for by `core.descriptors.partial_matching`.
    """

    name: str
    title: str
    unit: str
    perturb: Callable[[Mesh, float, int], Mesh]
    amounts: tuple[float, ...]
    certain: tuple[float, ...] = ()
    part: bool = False


KINDS = (
    Kind("noise", "Gaussian noise", "% of the diagonal", add_noise, (0.001, 0.003, 0.005, 0.01)),
    Kind("holes", "holes", "% of the area gone", remove_discs, (0.1, 0.2, 0.3, 0.4), part=True),
    Kind("cut", "a part cut away", "% of the area gone", cut_part, (0.1, 0.2, 0.3, 0.4), part=True),
    Kind("decimation", "decimation", "% of the faces kept", decimate, (0.5, 0.25, 0.1)),
    Kind("subdivision", "subdivision", "% of the edges split", subdivide, (0.5, 1.0), certain=(1.0,)),
    Kind("soup", "triangle soup", "% drawn in", make_soup, (0.0, 0.01, 0.05), certain=(0.0,)),
    Kind("parts", "loose parts", "% of the diagonal away", separate_parts, (0.005, 0.02)),
)


@dataclass(frozen=True)
class Retrieval:
    """Share of the queries whose first answer is of their class.

    Attributes
    ----------
    cc, combined : float
        By CC, and by the combined score.
    part : float or None
        By the distance of `core.descriptors.partial_matching.part_distances`; None where nothing is missing.
    """

    cc: float
    combined: float
    part: float | None = None


@dataclass(frozen=True)
class Level:
    """What one amount of one kind does to retrieval.

    Attributes
    ----------
    kind : str
        The name of a `Kind`, or `TAU`.
    amount : float
    runs : tuple of Retrieval
        One a seed.
    own_cc : tuple of float
        One a seed: the mean CC of the perturbed shapes with their own clean selves; empty for `TAU`.
    unusable : tuple of int
        One a seed: how many perturbed shapes could not be embedded. They count as answered wrongly.
    """

    kind: str
    amount: float
    runs: tuple[Retrieval, ...]
    own_cc: tuple[float, ...]
    unusable: tuple[int, ...]

    def ends(self, rank_by: str) -> tuple[float, float, float]:
        """Mean, smallest and largest over the seeds; `rank_by` is "cc", "combined" or "part"."""
        found = [float(getattr(run, rank_by)) for run in self.runs]
        return float(np.mean(found)), min(found), max(found)


@dataclass(frozen=True)
class Study:
    """All that was measured on a collection.

    Attributes
    ----------
    collection : str
    shapes, classes, seeds : int
    clean : Retrieval
        Without any perturbation.
    levels : tuple of Level
        Those of one kind follow each other, the mildest first.
    """

    collection: str
    shapes: int
    classes: int
    seeds: int
    clean: Retrieval
    levels: tuple[Level, ...]


def tau_parameters(tau: float) -> Parameters:
    """The default setting with the paper's sparse ratio in place of a fixed number of samples.

    The vertices that tau is a share of are `TAU_VERTICES`, for the gallery and the queries alike.
    """
    return DEFAULT.with_values(
        name=f"tau {tau}",
        samples=0,
        tau=tau,
        sample_cap=TAU_CAP,
        refine_vertices=TAU_LEAST,
        decimate_above=TAU_VERTICES + 1,
        decimate_to=TAU_VERTICES,
    )


def nearest_neighbour(
    likeness: Mapping[str, Floats], scored: NDArray[np.bool_], labels: Sequence[str]
) -> Retrieval:
    """NN of `core.evaluation.retrieval_measures`, row i of each array being query i and column j stored shape j.

    Parameters
    ----------
    likeness : mapping of str to float64, shape (n, n)
        By the names of `Retrieval`; greater for what is more alike. Not symmetric, since only the query is
        perturbed. The diagonal is not read.
    scored : bool, shape (n, n)
        Where they hold scores. A shape that was not scored is the last answer; a query without any finds
        nothing.
    labels : sequence of n str
    """
    pairs = scored & ~np.eye(len(labels), dtype=bool)
    shares = {}
    for name, scores in likeness.items():
        found = scores[pairs]
        matrix = np.full(scores.shape, found.min(initial=0.0) - 1.0)
        matrix[pairs] = found
        shares[name] = evaluate(matrix, labels, larger_is_closer=True).nn
    return Retrieval(**shares)
