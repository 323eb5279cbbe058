"""The parameters of the method, their two named settings, and the fingerprint."""

import hashlib
import json
from dataclasses import asdict, dataclass, fields
from typing import Literal, Self, get_args

from core.errors import ParameterError

METHOD_VERSION = 1
"""Raised whenever the same parameters would give other embeddings or other scores."""

Selection = Literal["sort-and-cut", "random-draw", "covering"]
Distances = Literal["tree", "graph", "geodesic"]
Affinity = Literal["gaussian", "distance"]
Operator = Literal["affinity", "laplace-beltrami"]
Pairs = Literal["both-ways", "nearest"]


LATER: dict[str, float] = {"fill_holes": 0.0, "smooth_refined": False, "patches": False}
"""Parameters that came later, with the value that stands for the method before: it changes no fingerprint."""


@dataclass(frozen=True)
class Parameters:
    """A frozen set of parameters; every stored embedding carries its fingerprint.

    Attributes
    ----------
    name : str
        What people call it; not part of the fingerprint.
    fill_holes : float
        Rims are closed that bound at most this share of the surface: see `core.mesh.hole_filling`; 0 for none.
    refine_vertices : int
        Long edges are split as for an even mesh of so many vertices; 0 leaves the mesh as it is.
    decimate_above, decimate_to : int
        A mesh of more vertices than the first is simplified to about the second; 0 never.
    smooth_above : float
        A mesh whose `core.mesh.denoising.roughness` is above is smoothed, for so many `smooth_rounds`; 0 never.
    smooth_rounds : int
    smooth_refined : bool
        Whether it must be as rough when its long edges are split: the corners of a coarse mesh are no noise.
    degree, epsilon, normalise_weights
        Of the Lewis weights: see `core.sampling.lewis_weights.lewis_weights`.
    selection : "sort-and-cut", "random-draw" or "covering"
        How samples are taken by their weights; `coverage_power` belongs to "covering", `seed` to the draw.
    samples : int
        A fixed number of samples, or 0 for `tau`.
    tau : float
        Sparse ratio in (0, 1]: samples over vertices.
    sample_cap : int
        The most samples that tau may ask for; 0 for no cap.
    points : int
        So many points are embedded in all, the samples the first of them; 0 for the
        samples alone, as it is where selection, distances or affinity are not "covering", "geodesic" and
        "gaussian".
    unfold : bool
        Whether shortest paths may cross pairs of faces besides following edges.
    distances : "tree", "graph" or "geodesic"
        Between samples: along the minimum spanning tree, the sparse graph, or the whole mesh.
    affinity : "gaussian" or "distance", width : float
        See `core.spectral.affinity`.
    operators : tuple of "affinity" and "laplace-beltrami"
        One embedding each. With pairs "both-ways" all share one correspondence; with "nearest" each has its
        own and the first's is shown. Scores are the means over them.
    dimensions : int
        k, after the near-constant eigenvector.
    eigenvalue_power : float
        Coordinates carry |eigenvalue| to this power (a Laplacian's to minus it); the paper's is 0.
    taper : bool
        Whether coordinates fade out towards the first eigenvalue left out: see
        `core.spectral.coordinates.spectral_coordinates`.
    search_samples, search_dimensions : int
        With pairs "both-ways", the search for where to begin goes over so many of the samples, and up to so
        many dimensions; 0 for all of them, as it is with "nearest".
    first_dimensions, sign_starts, kept_starts, start_iterations, step_iterations
        See `core.matching.correspondence.Search`. With pairs "both-ways" one start is kept of each search.
    stiffness : float
        The spline's beta over the mean distance between all pairs of points (the paper: 1).
    warp_stiffness : float
        The same for the softer spline under which sim counts effective pairs; with pairs "nearest", sim reads
        the first spline.
    pairs : "both-ways" or "nearest"
        Whether scores read nearest neighbours both ways after an orthogonal map in each embedding
        (`core.matching.kernels.pair_matching`); or nearest neighbours of the points that the spline has warped.
    align_samples, kept_maps, align_rounds : int
        The maps that searches in each embedding from either side find are fitted anew to nearest neighbours
        both ways between so many of the samples, once, and so many of them, best correlation first, then so
        often again.
    final_rounds : int
        How often the best map is fitted to all samples.
    slide_rounds : int
        How often then each sample's partner moves to the nearest of the points in its partner's region, and
        the map is fitted to those; 0 leaves partners at the samples.
    affinity_values, laplacian_values : int
        Eigenvalues of each kind in the signature.
    form : bool
        Whether the signature holds the terms of `core.descriptors.global_descriptors` as well.
    patches : bool
        Whether what lies about points of the surface is kept too, for `combined`: see `core.descriptors.descriptor_distance`.
    match_threshold : float
        A query whose best CC is below has no match (Algorithm 3's unmatched shapes). `isoshape classify`
        finds the best for a collection: 0.980 for half of PSB, 0.985 for the made gallery, 0.992 for half of
        SHREC'11.
    """

    name: str = "default"
    fill_holes: float = 0.9
    refine_vertices: int = 2000
    decimate_above: int = 30_000
    decimate_to: int = 5_000
    smooth_above: float = 0.2
    smooth_rounds: int = 10
    smooth_refined: bool = True
    degree: int = 6
    epsilon: float = 0.01
    normalise_weights: bool = True
    selection: Selection = "covering"
    coverage_power: float = 0.25
    seed: int = 0
    samples: int = 100
    tau: float = 0.3
    sample_cap: int = 0
    points: int = 500
    unfold: bool = True
    distances: Distances = "geodesic"
    affinity: Affinity = "gaussian"
    width: float = 1.5
    operators: tuple[Operator, ...] = ("affinity", "laplace-beltrami")
    dimensions: int = 10
    eigenvalue_power: float = 0.5
    taper: bool = True
    search_samples: int = 32
    search_dimensions: int = 6
    first_dimensions: int = 3
    sign_starts: bool = True
    kept_starts: int = 1
    start_iterations: int = 1
    step_iterations: int = 1
    stiffness: float = 100.0
    warp_stiffness: float = 0.1
    pairs: Pairs = "both-ways"
    align_samples: int = 64
    kept_maps: int = 2
    align_rounds: int = 2
    final_rounds: int = 1
    slide_rounds: int = 1
    affinity_values: int = 0
    laplacian_values: int = 30
    form: bool = True
    patches: bool = True
    match_threshold: float = 0.98

    def __post_init__(self) -> None:
        object.__setattr__(self, "operators", tuple(self.operators))
        for each in fields(self):
            value = getattr(self, each.name)
            # 1 and 1.0 are equal, and must have one fingerprint.
            if each.type is float and isinstance(value, int) and not isinstance(value, bool):
                object.__setattr__(self, each.name, _as_float(each.name, value))
        for field, allowed in (("selection", Selection), ("distances", Distances), ("affinity", Affinity)):
            if getattr(self, field) not in get_args(allowed):
                raise ParameterError(f"{field} must be one of {', '.join(get_args(allowed))}")
        if self.pairs not in get_args(Pairs):
            raise ParameterError(f"pairs must be one of {', '.join(get_args(Pairs))}")
        if not self.operators or any(name not in get_args(Operator) for name in self.operators):
            raise ParameterError(f"operators must be one or more of {', '.join(get_args(Operator))}")
        if len(set(self.operators)) < len(self.operators):
            raise ParameterError("operators must differ")
        self._check_ranges()

    def _check_ranges(self) -> None:
        rules = {
            "fill_holes must be 0 to 10": 0.0 <= self.fill_holes <= 10.0,
            "refine_vertices must be 0 to 100,000": 0 <= self.refine_vertices <= 100_000,
            "decimate_to must be at least 500 and below decimate_above": self.decimate_above == 0
            or 500 <= self.decimate_to < self.decimate_above,
            "smooth_above must be 0 to 1,000": 0.0 <= self.smooth_above <= 1000.0,
            "smooth_rounds must be 1 to 1,000": 1 <= self.smooth_rounds <= 1000,
            "degree must be 1 to 12": 1 <= self.degree <= 12,
            "epsilon must lie between 0 and 1/7": 0.0 < self.epsilon < 1.0 / 7.0,
            "coverage_power must be 0 to 4": 0.0 <= self.coverage_power <= 4.0,
            "dimensions must be 2 to 50": 2 <= self.dimensions <= 50,
            "samples must be 0, or at least dimensions + 2, and at most 10,000": self.samples == 0
            or self.dimensions + 2 <= self.samples <= 10_000,
            "points must be 0 to 20,000": 0 <= self.points <= 20_000,
            "tau must be above 0 and at most 1": 0.0 < self.tau <= 1.0,
            "sample_cap must be 0 or at least dimensions + 2": self.sample_cap == 0
            or self.sample_cap >= self.dimensions + 2,
            "width must be positive": 0.0 < self.width < 1e6,
            "eigenvalue_power must be 0 to 4": 0.0 <= self.eigenvalue_power <= 4.0,
            "seed must be 0 to 2^62": 0 <= self.seed <= 2**62,
            "search_dimensions must be 0 or at least first_dimensions, and at most 50": self.search_dimensions
            == 0
            or self.first_dimensions <= self.search_dimensions <= 50,
            "search_samples must be 0 or at least dimensions + 2, and at most 10,000": self.search_samples
            == 0
            or self.dimensions + 2 <= self.search_samples <= 10_000,
            "first_dimensions must be 2 to 6 and at most dimensions": 2
            <= self.first_dimensions
            <= min(6, self.dimensions)
            or (not self.sign_starts and self.first_dimensions == self.dimensions),
            "iteration and start counts must be 1 to 1,000": all(
                1 <= count <= 1000
                for count in (
                    self.kept_starts,
                    self.start_iterations,
                    self.step_iterations,
                    self.kept_maps,
                    self.align_rounds,
                    self.final_rounds,
                )
            ),
            "align_samples must be at least dimensions + 2 and at most 10,000": self.dimensions + 2
            <= self.align_samples
            <= 10_000,
            "slide_rounds must be 0 to 1,000": 0 <= self.slide_rounds <= 1000,
            "stiffness and warp_stiffness must be above 0": 0.0 < self.stiffness < 1e12
            and 0.0 < self.warp_stiffness < 1e12,
            "affinity_values and laplacian_values must be 0 to 100": 0 <= self.affinity_values <= 100
            and 0 <= self.laplacian_values <= 100,
            "affinity_values and laplacian_values must not both be 0": self.affinity_values
            + self.laplacian_values
            > 0,
            "match_threshold must be -1 to 1": -1.0 <= self.match_threshold <= 1.0,
        }
        for rule, holds in rules.items():
            if not holds:
                raise ParameterError(rule)

    @property
    def fingerprint(self) -> str:
        """Sixteen hexadecimal digits: a hash of the parameters and of the method version."""
        left_out = {"name", *(name for name, before in LATER.items() if getattr(self, name) == before)}
        values = {name: value for name, value in asdict(self).items() if name not in left_out}
        text = json.dumps({"method": METHOD_VERSION, **values}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def to_json(self) -> str:
        """All parameters as a JSON object."""
        return json.dumps(asdict(self), indent=2)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Parameters from a JSON object; those it does not name have the default setting's values.

        Raises
        ------
        ParameterError
            Not JSON, an unknown name, a wrong type, or a value out of its range.
        """
        try:
            values = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ParameterError(f"not JSON: {error}") from error
        if not isinstance(values, dict):
            raise ParameterError("parameters must be a JSON object")
        known = {field.name: getattr(DEFAULT, field.name) for field in fields(cls)}
        for name, value in values.items():
            if name not in known:
                raise ParameterError(f"unknown parameter {name!r}; known are {', '.join(known)}")
            wanted = type(known[name])
            good = isinstance(value, wanted) and isinstance(value, bool) == (wanted is bool)
            if wanted is float:
                good = isinstance(value, int | float) and not isinstance(value, bool)
            elif wanted is tuple:
                good = isinstance(value, list) and all(isinstance(entry, str) for entry in value)
            if not good:
                raise ParameterError(f"{name} must be of the kind of {known[name]!r}, not {value!r}")
        return cls(**values)


def _as_float(name: str, value: int) -> float:
    try:
        return float(value)
    except OverflowError as error:
        raise ParameterError(f"{name} is too large") from error


DEFAULT = Parameters()
"""The best that was measured; see the README's table."""

PAPER = Parameters(
    name="paper",
    fill_holes=0.0,
    refine_vertices=0,
    decimate_above=0,
    smooth_above=0.0,
    smooth_refined=False,
    normalise_weights=False,
    selection="sort-and-cut",
    samples=0,
    tau=0.3,
    sample_cap=400,
    points=0,
    unfold=False,
    distances="tree",
    affinity="distance",
    operators=("affinity",),
    dimensions=3,
    eigenvalue_power=0.0,
    taper=False,
    search_samples=0,
    search_dimensions=0,
    first_dimensions=3,
    sign_starts=False,
    kept_starts=1,
    start_iterations=10,
    step_iterations=1,
    stiffness=1.0,
    pairs="nearest",
    affinity_values=20,
    laplacian_values=0,
    form=False,
    patches=False,
)
"""As literal as the text allows, with the errata of the README's table "How the paper is read"."""
