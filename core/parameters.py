"""The parameters of the method in four groups, their two named settings, and the fingerprint."""

import hashlib
import json
from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from core.errors import ParameterError

METHOD_VERSION = 17
"""Raised whenever the same parameters would give other embeddings or other scores."""

Rounds = Annotated[int, Field(ge=1, le=1000)]
Power = Annotated[float, Field(ge=0.0, le=4.0)]
Stiffness = Annotated[float, Field(gt=0.0, lt=1e12)]
SignatureLength = Annotated[int, Field(ge=0, le=100)]

INCOMPLETE = 0.03
"""A surface with a larger boundary ratio counts as incomplete.

The value comes from every fourth model of the Princeton Segmentation Benchmark, all closed. With a part of
10 % of the area cut away, 83 % of the models exceed it; with 20 %, 98 %; with 30 %, all. With five holes of
0.2 % of the area together, 2 % exceed it; with 1 % together, 8 %.
"""


class Group(BaseModel):
    """A frozen group of parameters. Types are exact: no number is read from text, and none is infinite."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class MeshParameters(Group):
    """Preparation of a mesh before it is sampled.

    Attributes
    ----------
    fill_holes : float
        A hole is closed if a disc with the hole's perimeter covers at most this share of the area of its
        component; 0 closes none. See `core.mesh.preparation`.
    refine_vertices : int
        Long edges are split until the mesh is as fine as an even mesh of this many vertices; 0 splits only
        as far as the samples need.
    decimate_above, decimate_to : int
        A mesh with more than `decimate_above` vertices is simplified to about `decimate_to`; 0 never.
    decimate_pieces_above : int
        The limit for a mesh of many small pieces (`core.mesh.preparation.CONNECTED`), which simplification
        would remove; 0 takes `decimate_above`.
    refine_simplified : int
        Long edges of a simplified mesh are split until it is as fine as an even mesh of this many vertices; 0
        treats it as any other mesh.
    smooth_above : float
        A mesh is smoothed if its `core.mesh.preparation.roughness` is above this value; 0 never.
    smooth_rounds : int
        Rounds of Taubin smoothing.
    smooth_refined : bool
        Whether the mesh must also be rough after its long edges are split. The corners of a coarse mesh are
        not noise.
    """

    fill_holes: float = Field(default=0.9, ge=0.0, le=10.0)
    refine_vertices: int = Field(default=2000, ge=0, le=100_000)
    decimate_above: int = 8_000
    decimate_to: int = 4_000
    decimate_pieces_above: int = Field(default=30_000, ge=0)
    refine_simplified: int = Field(default=3000, ge=0, le=100_000)
    smooth_above: float = Field(default=0.2, ge=0.0, le=1000.0)
    smooth_rounds: Rounds = 10
    smooth_refined: bool = True

    @model_validator(mode="after")
    def _decimates_downwards(self) -> Self:
        if self.decimate_above and not 500 <= self.decimate_to < self.decimate_above:
            raise ValueError("decimate_to must be at least 500 and below decimate_above")
        if 0 < self.decimate_pieces_above <= self.decimate_to:
            raise ValueError("decimate_pieces_above must be 0 or above decimate_to")
        return self


class SamplingParameters(Group):
    """Choice of the vertices that become samples (sections 3.1 and 3.2, Algorithm 1).

    Attributes
    ----------
    degree, epsilon : int, float
        Degree of the polynomial that the Lewis weights fit (Eq. 8), and the error parameter of Eqs. 11 and
        12. See `core.sampling.lewis_weights.lewis_weights`.
    normalise_weights : bool
        Whether the two terms of Eqs. 11 and 12 are divided by their sums, so that both count.
    selection : "sort-and-cut", "random-draw" or "covering"
        The largest weights (the paper), a draw with probabilities proportional to the weights, or
        farthest-point sampling weighted by the weights.
    coverage_power : float
        Exponent of the weights in "covering"; 0 is plain farthest-point sampling.
    seed : int
        Seed of "random-draw".
    samples : int
        The number of samples; 0 takes `tau` times the number of vertices.
    tau : float
        The paper's sparse ratio, in (0, 1].
    sample_cap : int
        The largest number of samples that `tau` gives; 0 is no limit.
    points : int
        The number of points that are embedded; the samples are the first of them. 0 embeds the samples
        alone, as do parameters other than selection "covering", distances "geodesic", affinity "gaussian".
    """

    degree: int = Field(default=6, ge=1, le=12)
    epsilon: float = Field(default=0.01, gt=0.0, lt=1.0 / 7.0)
    normalise_weights: bool = True
    selection: Literal["sort-and-cut", "random-draw", "covering"] = "covering"
    coverage_power: Power = 0.25
    seed: int = Field(default=0, ge=0, le=2**62)
    samples: int = Field(default=100, ge=0, le=10_000)
    tau: float = Field(default=0.3, gt=0.0, le=1.0)
    sample_cap: int = Field(default=0, ge=0)
    points: int = Field(default=500, ge=0, le=20_000)


class SpectralParameters(Group):
    """The spectral embeddings and the signature of eigenvalues (section 3.3).

    Attributes
    ----------
    distances : "tree", "graph" or "geodesic"
        Distances between samples along the minimum spanning tree (the paper), along the sparse graph, or
        along the whole mesh.
    unfold : bool
        Whether shortest paths may cross pairs of adjacent faces, besides following edges.
    affinity : "gaussian" or "distance"
        The affinity matrix of the distances. See `core.spectral.affinity`.
    width : float
        Width of the Gaussian affinity.
    operators : tuple of "affinity" and "laplace-beltrami"
        The operators whose eigenvectors embed the surface; each gives one embedding, and scores are means
        over the embeddings. With pairs "both-ways", all embeddings share one correspondence. With "nearest",
        each has its own, and matches show that of the first.
    dimensions : int
        k, the number of eigenvectors after the near-constant one.
    eigenvalue_power : float
        Coordinates are scaled by |eigenvalue| to this power, those of a Laplacian by its reciprocal; 0 in
        the paper.
    taper : bool
        Whether coordinates fade towards the first eigenvalue left out. See
        `core.spectral.spectral_embedding.spectral_coordinates`.
    affinity_values, laplacian_values : int
        The numbers of eigenvalues of each operator in the signature; at least one is above 0.
    """

    distances: Literal["tree", "graph", "geodesic"] = "geodesic"
    unfold: bool = True
    affinity: Literal["gaussian", "distance"] = "gaussian"
    width: float = Field(default=1.5, gt=0.0, lt=1e6)
    operators: tuple[Literal["affinity", "laplace-beltrami"], ...] = Field(
        default=("affinity", "laplace-beltrami"), min_length=1, strict=False
    )
    dimensions: int = Field(default=10, ge=2, le=50)
    eigenvalue_power: Power = 0.5
    taper: bool = True
    affinity_values: SignatureLength = 0
    laplacian_values: SignatureLength = 30

    @model_validator(mode="after")
    def _has_operators_and_values(self) -> Self:
        if len(set(self.operators)) < len(self.operators):
            raise ValueError("operators must differ")
        if self.affinity_values + self.laplacian_values == 0:
            raise ValueError("affinity_values and laplacian_values must not both be 0")
        return self


class MatchingParameters(Group):
    """The correspondence of two embeddings (Eq. 17) and its scores.

    Attributes
    ----------
    search_samples, search_dimensions : int
        With pairs "both-ways", the search for initial maps uses the first `search_samples` samples and up to
        `search_dimensions` dimensions; 0 uses all. With "nearest" it uses all.
    first_dimensions : int
        The number of dimensions in which the search begins; each step adds one. At most 6, or equal to
        `dimensions` if `sign_starts` is false.
    sign_starts : bool
        Whether the search tries all 2^first_dimensions signs of the first coordinates.
    kept_starts : int
        With pairs "nearest", the number of starts, best correlation first, that go through all steps; with
        "both-ways" one does.
    start_iterations, step_iterations : int
        Iterations of the spline for each start, and after each added dimension.
    stiffness : float
        The spline's beta over the mean distance between all pairs of points; 1 in the paper.
    warp_stiffness : float
        With pairs "both-ways", the same for the softer spline under which sim counts effective pairs.
    pairs : "both-ways" or "nearest"
        "both-ways" finds nearest neighbours in both directions after one orthogonal map
        (`core.matching.kernels.pair_matching`); "nearest" finds nearest neighbours of the points that the
        spline has warped (the paper).
    align_samples, kept_maps, align_rounds : int
        Every initial map is refined once on `align_samples` samples; the best `kept_maps` are refined
        `align_rounds` more times.
    final_rounds : int
        Refinements of the best map on all samples.
    slide_rounds : int
        Refinements after those, in which the partner of a sample may be any point in its partner's region;
        0 keeps samples as partners.
    """

    search_samples: int = Field(default=32, ge=0, le=10_000)
    search_dimensions: int = Field(default=6, ge=0, le=50)
    first_dimensions: int = Field(default=3, ge=2, le=50)
    sign_starts: bool = True
    kept_starts: Rounds = 1
    start_iterations: Rounds = 1
    step_iterations: Rounds = 1
    stiffness: Stiffness = 100.0
    warp_stiffness: Stiffness = 0.1
    pairs: Literal["both-ways", "nearest"] = "both-ways"
    align_samples: int = Field(default=64, le=10_000)
    kept_maps: Rounds = 2
    align_rounds: Rounds = 2
    final_rounds: Rounds = 1
    slide_rounds: int = Field(default=1, ge=0, le=1000)

    @model_validator(mode="after")
    def _searches_upwards(self) -> Self:
        if self.search_dimensions and self.search_dimensions < self.first_dimensions:
            raise ValueError("search_dimensions must be 0 or at least first_dimensions")
        return self


GROUPS = ("mesh", "sampling", "spectral", "matching")


class Parameters(BaseModel):
    """A frozen, hashable set of parameters in groups; every stored embedding carries its fingerprint.

    The name, which people use, is not part of the fingerprint.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    name: str = "default"
    mesh: MeshParameters = MeshParameters()
    sampling: SamplingParameters = SamplingParameters()
    spectral: SpectralParameters = SpectralParameters()
    matching: MatchingParameters = MatchingParameters()

    @model_validator(mode="after")
    def _fit_the_dimensions(self) -> Self:
        """Check the rules that hold between groups."""
        least = self.spectral.dimensions + 2
        for name, value, zero in (
            ("samples", self.sampling.samples, True),
            ("sample_cap", self.sampling.sample_cap, True),
            ("search_samples", self.matching.search_samples, True),
            ("align_samples", self.matching.align_samples, False),
        ):
            if value < least and not (zero and value == 0):
                raise ValueError(f"{name} must be {'0 or ' if zero else ''}at least dimensions + 2")
        first = self.matching.first_dimensions
        most = self.spectral.dimensions
        if first > min(6, most) and (self.matching.sign_starts or first != most):
            least_of = "at most 6 and at most dimensions, or equal to dimensions if sign_starts is false"
            raise ValueError(f"first_dimensions must be {least_of}")
        return self

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> Self:
        """Return parameters from a name and groups of values; all others have the defaults.

        Raise ParameterError for an unknown parameter, a wrong type, or a value out of its range.
        """
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            raise ParameterError("; ".join(_explained(fault) for fault in error.errors())) from error

    def with_values(self, **changes: object) -> Self:
        """Return these parameters with another name, or other values in the named groups.

        `DEFAULT.with_values(name="few", sampling={"samples": 60})` differs from `DEFAULT` in these two.
        Errors are those of `from_values`.
        """
        values: dict[str, Any] = self.model_dump()
        for key, change in changes.items():
            values[key] = (
                {**values[key], **change} if isinstance(change, Mapping) and key in GROUPS else change
            )
        return self.from_values(values)

    @cached_property
    def fingerprint(self) -> str:
        """Sixteen hexadecimal digits: a hash of the values of all groups and of the method version."""
        values = {"method": METHOD_VERSION, **self.model_dump(exclude={"name"})}
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return parameters from a JSON object of groups; values that it lacks have the defaults.

        Raise ParameterError for other text, and the errors of `from_values`.
        """
        try:
            values = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ParameterError(f"not JSON: {error}") from error
        if not isinstance(values, dict):
            raise ParameterError("parameters must be a JSON object")
        return cls.from_values(values)


def _explained(error: Mapping[str, Any]) -> str:
    """Return the parameter and the cause of one of pydantic's errors."""
    path = [str(part) for part in error["loc"]]
    if error["type"] == "extra_forbidden":
        model = Parameters if len(path) == 1 else Parameters.model_fields[path[0]].annotation
        known = ", ".join(getattr(model, "model_fields", {}))
        return f"unknown parameter {'.'.join(path)!r}; known are {known}"
    if error["type"] == "value_error":
        return str(error["ctx"]["error"])
    return f"{'.'.join(path)}: {error['msg'][0].lower()}{error['msg'][1:]}"


DEFAULT = Parameters()
"""The best that was measured; see docs/results.md."""

PAPER = Parameters(
    name="paper",
    mesh=MeshParameters(
        fill_holes=0.0,
        refine_vertices=0,
        decimate_above=0,
        decimate_to=5_000,
        decimate_pieces_above=0,
        refine_simplified=0,
        smooth_above=0.0,
        smooth_refined=False,
    ),
    sampling=SamplingParameters(
        normalise_weights=False, selection="sort-and-cut", samples=0, tau=0.3, sample_cap=400, points=0
    ),
    spectral=SpectralParameters(
        distances="tree",
        unfold=False,
        affinity="distance",
        operators=("affinity",),
        dimensions=3,
        eigenvalue_power=0.0,
        taper=False,
        affinity_values=20,
        laplacian_values=0,
    ),
    matching=MatchingParameters(
        search_samples=0,
        search_dimensions=0,
        first_dimensions=3,
        sign_starts=False,
        kept_starts=1,
        start_iterations=10,
        step_iterations=1,
        stiffness=1.0,
        pairs="nearest",
    ),
)
"""As literal as the text allows, with the errata of the page docs/method.md."""
