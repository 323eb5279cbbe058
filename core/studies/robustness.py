"""Robustness of retrieval: perturbed queries against a clean collection (Fig. 9), kinds and measures.

Each shape in turn is perturbed and is the query; the unperturbed shape is left out of the ranking.
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
"""With a sparse ratio, meshes are simplified to about this number of vertices, and meshes below `TAU_LEAST`
are refined. This makes tau = 0.8 feasible: twice the samples take five times as long to match."""

TAU_LEAST = 500
"""Far enough below `TAU_VERTICES` that a simplified mesh is not refined again."""

TAU_CAP = 480
"""Largest number of samples, 0.8 of `TAU_VERTICES`; a few meshes have more vertices than that."""


@dataclass(frozen=True)
class Perturbation:
    """One kind of perturbation, with its amounts.

    Attributes
    ----------
    name : str
    title : str
        Description of the perturbation.
    unit : str
        Description of the amounts, which are in per cent.
    perturb : callable
        Function of a mesh, an amount and a seed that returns a mesh.
    amounts : tuple of float
        Ascending, the mildest first.
    certain : tuple of float
        The amounts at which the perturbation is deterministic, so one seed suffices.
    part : bool
        Whether the result is a part of the shape, which is also searched by partial matching
        (`core.descriptors.partial_matching`).
    """

    name: str
    title: str
    unit: str
    perturb: Callable[[Mesh, float, int], Mesh]
    amounts: tuple[float, ...]
    certain: tuple[float, ...] = ()
    part: bool = False


KINDS = (
    Perturbation("noise", "Gaussian noise", "% of the diagonal", add_noise, (0.001, 0.003, 0.005, 0.01)),
    Perturbation("holes", "holes", "% of the area gone", remove_discs, (0.1, 0.2, 0.3, 0.4), part=True),
    Perturbation("cut", "a part cut away", "% of the area gone", cut_part, (0.1, 0.2, 0.3, 0.4), part=True),
    Perturbation("decimation", "decimation", "% of the faces kept", decimate, (0.5, 0.25, 0.1)),
    Perturbation("subdivision", "subdivision", "% of the edges split", subdivide, (0.5, 1.0), certain=(1.0,)),
    Perturbation("soup", "triangle soup", "% drawn in", make_soup, (0.0, 0.01, 0.05), certain=(0.0,)),
    Perturbation("parts", "loose parts", "% of the diagonal away", separate_parts, (0.005, 0.02)),
)


@dataclass(frozen=True)
class Retrieval:
    """Nearest-neighbour accuracy: share of queries with a first result of their class, in [0, 1].

    Attributes
    ----------
    cc, combined : float
        Ranked by CC, and by the combined score.
    part : float or None
        Ranked by `core.descriptors.partial_matching.part_distances`; None if no part is missing.
    """

    cc: float
    combined: float
    part: float | None = None


@dataclass(frozen=True)
class Level:
    """Retrieval at one amount of one kind of perturbation.

    Attributes
    ----------
    kind : str
        Name of a `Kind`, or `TAU`.
    amount : float
    runs : tuple of Retrieval
        Accuracy for each seed.
    own_cc : tuple of float
        Mean CC of the perturbed shapes with the unperturbed ones, for each seed; empty for `TAU`.
    unusable : tuple of int
        Number of perturbed shapes that cannot be embedded, for each seed; they count as errors.
    """

    kind: str
    amount: float
    runs: tuple[Retrieval, ...]
    own_cc: tuple[float, ...]
    unusable: tuple[int, ...]

    def ends(self, rank_by: str) -> tuple[float, float, float]:
        """Mean, minimum and maximum over the seeds; `rank_by` is "cc", "combined" or "part"."""
        found = [float(getattr(run, rank_by)) for run in self.runs]
        return float(np.mean(found)), min(found), max(found)


@dataclass(frozen=True)
class RobustnessStudy:
    """All measurements of a collection.

    Attributes
    ----------
    collection : str
        Its name.
    shapes, classes, seeds : int
        Numbers of shapes, classes and seeds.
    clean : Retrieval
        Without perturbation.
    levels : tuple of Level
        Grouped by kind, the mildest first.
    """

    collection: str
    shapes: int
    classes: int
    seeds: int
    clean: Retrieval
    levels: tuple[Level, ...]


def tau_parameters(tau: float) -> Parameters:
    """The default parameters with the paper's sparse ratio tau instead of a fixed number of samples.

    tau is relative to `TAU_VERTICES` vertices, for stored shapes and for queries.
    """
    return DEFAULT.with_values(
        name=f"tau {tau}",
        sampling={"samples": 0, "tau": tau, "sample_cap": TAU_CAP},
        mesh={
            "refine_vertices": TAU_LEAST,
            "decimate_above": TAU_VERTICES + 1,
            "decimate_to": TAU_VERTICES,
            "decimate_pieces_above": 0,
            "refine_simplified": 0,
        },
    )


def nearest_neighbour(
    similarities: Mapping[str, Floats], scored: NDArray[np.bool_], labels: Sequence[str]
) -> Retrieval:
    """Nearest-neighbour accuracy of n perturbed queries (rows) against n stored shapes (columns).

    Parameters
    ----------
    similarities : mapping of str to float64, shape (n, n)
        Similarities, by the names of the fields of `Retrieval`. They are not symmetric, since the query only
        is perturbed. The diagonal is not read.
    scored : bool, shape (n, n)
        Whether each pair has a score. A shape without a score is ranked last; a query without any score
        counts as an error.
    labels : sequence of n str
        The class of each shape.
    """
    pairs = scored & ~np.eye(len(labels), dtype=bool)
    shares = {}
    for name, scores in similarities.items():
        found = scores[pairs]
        matrix = np.full(scores.shape, found.min(initial=0.0) - 1.0)
        matrix[pairs] = found
        shares[name] = evaluate(matrix, labels, larger_is_closer=True).nn
    return Retrieval(**shares)
