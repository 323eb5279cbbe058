"""A surface with the data for the sampling study, and the sampling methods."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.sparse import csc_array, csr_array
from scipy.sparse.csgraph import dijkstra

from core.arrays import Floats, Ints
from core.graph.edge_graph import edge_graph
from core.graph.geodesics import farthest_points
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import NormalFrame
from core.parameters import DEFAULT, Parameters
from core.pipeline import Pipeline
from core.sampling.lewis_weights import lewis_weights
from core.sampling.poisson_disk import poisson_disk_of
from core.sampling.sampling import (
    draw_scale,
    keyed_uniform,
    random_draw,
    sort_and_cut,
    weighted_farthest_points,
)
from core.spectral.laplace_beltrami import laplacian

STUDY_PARAMETERS: Parameters = DEFAULT.with_values(
    name="sampling study",
    mesh={
        "decimate_above": 4000,
        "decimate_to": 3000,
        "decimate_pieces_above": 0,
        "refine_simplified": 0,
    },
)
"""The default parameters, but large meshes are simplified, since all pairwise distances are used."""

Way = Literal["cut", "draw", "covering", "poisson-disk", "farthest-point"]


@dataclass(frozen=True)
class SamplingMethod:
    """A sampling method; with Lewis weights, whether r1 and r2 are as printed or normalised."""

    way: Way
    printed: bool = False

    @property
    def weighted(self) -> bool:
        """Whether the method uses Lewis weights."""
        return self.way in {"cut", "draw", "covering"}

    @property
    def name(self) -> str:
        """The name in JSON, one word."""
        return f"{self.way}-printed" if self.printed else self.way


OURS = tuple(SamplingMethod(way, printed) for way in ("cut", "draw", "covering") for printed in (True, False))
OTHERS = (SamplingMethod("poisson-disk"), SamplingMethod("farthest-point"))
METHODS = OURS + OTHERS


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh in its normal frame, with the data for sampling.

    Attributes
    ----------
    mesh : Mesh
        The mesh of n vertices, in units of the shape's root mean square radius.
    cleaned : Mesh
        The cleaned mesh before refinement or simplification, in the file's frame and units.
    frame : NormalFrame
        The transform from the file's frame to the normal frame.
    """

    mesh: Mesh
    cleaned: Mesh
    frame: NormalFrame

    @classmethod
    def of(cls, mesh: Mesh) -> "Surface":
        """Clean a mesh and put it in its normal frame, by `Pipeline.normalise`.

        Raises
        ------
        DegenerateMeshError
            The mesh has no area.
        """
        normal, cleaned, frame, _ = Pipeline(STUDY_PARAMETERS).normalise(mesh)
        return cls(normal, cleaned.mesh, frame)

    @cached_property
    def graph(self) -> csr_array:
        """The edge graph with diagonals, shape (n, n)."""
        return edge_graph(self.mesh)

    @cached_property
    def distances(self) -> Floats:
        """Geodesic distances between all vertices, along the graph, shape (n, n)."""
        found = np.asarray(dijkstra(self.graph))
        return np.asarray(np.minimum(found, found.T))

    @cached_property
    def _laplacian(self) -> tuple[csc_array, Floats]:
        return laplacian(self.mesh)

    @property
    def stiffness(self) -> csc_array:
        """The cotangent Laplacian, shape (n, n)."""
        return self._laplacian[0]

    @property
    def areas(self) -> Floats:
        """Area of each vertex, shape (n,)."""
        return self._laplacian[1]

    @cached_property
    def _weights(self) -> dict[bool, Floats]:
        points, key = self.mesh.vertices, STUDY_PARAMETERS.sampling.seed + 1
        return {
            printed: lewis_weights(
                points,
                degree=STUDY_PARAMETERS.sampling.degree,
                epsilon=STUDY_PARAMETERS.sampling.epsilon,
                normalise=not printed,
                random=keyed_uniform(points, key),
            ).weights
            for printed in (True, False)
        }

    @cached_property
    def _uniform(self) -> Floats:
        return keyed_uniform(self.mesh.vertices, STUDY_PARAMETERS.sampling.seed)

    def select(self, method: SamplingMethod, count: int) -> Ints:
        """The samples of a method, shape (count,); random methods are seeded and repeatable."""
        points = self.mesh.vertices
        match method.way:
            case "cut":
                return sort_and_cut(self._weights[method.printed], count)
            case "draw":
                return random_draw(self._weights[method.printed], count, self._uniform)
            case "covering":
                weights = self._weights[method.printed]
                return weighted_farthest_points(
                    self.graph, points, weights, count, STUDY_PARAMETERS.sampling.coverage_power
                )
            case "poisson-disk":
                return poisson_disk_of(self.distances, count, np.argsort(self._uniform))[0]
            case "farthest-point":
                return farthest_points(self.graph, count, int(np.argmax((points**2).sum(axis=1))))

    def probability(self, method: SamplingMethod, count: int) -> Floats | None:
        """Inclusion probability of each vertex, shape (n,); None for a deterministic method."""
        if method.way != "draw":
            return None
        weights = self._weights[method.printed]
        return np.asarray(np.minimum(1.0, draw_scale(weights, count) * weights))

    def count(self, tau: float) -> int:
        """Number of samples at a sparse ratio."""
        return round(tau * len(self.mesh.vertices))

    def between(self, samples: Ints) -> Floats:
        """Geodesic distances between samples, shape (m, m)."""
        return np.asarray(self.distances[np.ix_(samples, samples)])
