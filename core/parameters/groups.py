"""The five groups of parameters, one for each part of the method, with their defaults and ranges."""

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

Selection = Literal["sort-and-cut", "random-draw", "covering"]
Distances = Literal["tree", "graph", "geodesic"]
Affinity = Literal["gaussian", "distance"]
Operator = Literal["affinity", "laplace-beltrami"]
Pairs = Literal["both-ways", "nearest"]

Rounds = Annotated[int, Field(ge=1, le=1000)]
Power = Annotated[float, Field(ge=0.0, le=4.0)]
Stiffness = Annotated[float, Field(gt=0.0, lt=1e12)]
SignatureLength = Annotated[int, Field(ge=0, le=100)]


class Group(BaseModel):
    """A frozen group of parameters. Types are exact: no number is read from text, and none is infinite."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class MeshParameters(Group):
    """Preparation of a mesh before it is sampled.

    Attributes
    ----------
    fill_holes : float
        A hole is closed if a disc with the hole's perimeter covers at most this share of the area of its
        component; 0 closes none. See `core.mesh.hole_filling`.
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
        A mesh is smoothed if its `core.mesh.denoising.roughness` is above this value; 0 never.
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
    selection: Selection = "covering"
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
        `core.spectral.coordinates.spectral_coordinates`.
    affinity_values, laplacian_values : int
        The numbers of eigenvalues of each operator in the signature; at least one is above 0.
    orientation : bool
        Whether an embedding with Laplace-Beltrami coordinates holds the signed areas that tell a map from its
        mirror image (`core.spectral.orientation`); pairs "both-ways" use them.
    """

    distances: Distances = "geodesic"
    unfold: bool = True
    affinity: Affinity = "gaussian"
    width: float = Field(default=1.5, gt=0.0, lt=1e6)
    operators: tuple[Operator, ...] = Field(
        default=("affinity", "laplace-beltrami"), min_length=1, strict=False
    )
    dimensions: int = Field(default=10, ge=2, le=50)
    eigenvalue_power: Power = 0.5
    taper: bool = True
    affinity_values: SignatureLength = 0
    laplacian_values: SignatureLength = 30
    orientation: bool = True

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
    pairs: Pairs = "both-ways"
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


class RankingParameters(Group):
    """Descriptors beside the embeddings, and the threshold of a match.

    Attributes
    ----------
    global_descriptors : bool
        Whether the signature also holds volume, hull and compactness ratios
        (`core.descriptors.global_descriptors`). In flat files the key is `form`.
    spin_images : bool
        Whether an embedding holds spin images of its surface, which `combined` compares
        (`core.descriptors.descriptor_distance`). In flat files the key is `patches`.
    views : bool
        Whether an embedding holds views of its surface from outside, which `combined` compares
        (`core.descriptors.view_descriptor`).
    match_threshold : float
        A query whose best CC is below this value has no match (Algorithm 3's unmatched shapes).
        `isoshape classify` finds the best value for a collection: 0.980 for half of PSB, 0.985 for the made
        gallery, 0.992 for half of SHREC'11.
    """

    global_descriptors: bool = Field(default=True, serialization_alias="form")
    spin_images: bool = Field(default=True, serialization_alias="patches")
    views: bool = True
    match_threshold: float = Field(default=0.98, ge=-1.0, le=1.0)
