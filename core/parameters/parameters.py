"""The parameters of the method, their two named settings, and the fingerprint."""

import hashlib
import json
from collections.abc import Mapping
from functools import cached_property
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from core.errors import ParameterError
from core.parameters.groups import (
    Group,
    MatchingParameters,
    MeshParameters,
    RankingParameters,
    SamplingParameters,
    SpectralParameters,
)

METHOD_VERSION = 1
"""Raised whenever the same parameters would give other embeddings or other scores."""

EARLIER_VALUES: dict[str, float] = {
    "fill_holes": 0.0,
    "decimate_pieces_above": 0,
    "refine_simplified": 0,
    "smooth_refined": False,
    "patches": False,
    "views": False,
    "orientation": False,
}
"""Flat keys that were added later, with the value that stands for the method before. A parameter with this
value is not part of the fingerprint."""

GROUPS: dict[str, type[Group]] = {
    "mesh": MeshParameters,
    "sampling": SamplingParameters,
    "spectral": SpectralParameters,
    "matching": MatchingParameters,
    "ranking": RankingParameters,
}

FLAT_KEYS = {
    name: field.serialization_alias or name
    for group in GROUPS.values()
    for name, field in group.model_fields.items()
}
"""The key of each parameter in flat files, by the parameter's name."""

_PLACES = {
    key: (group, name)
    for group, model in GROUPS.items()
    for name in model.model_fields
    for key in (name, FLAT_KEYS[name])
}


class Parameters(BaseModel):
    """A frozen, hashable set of parameters in groups; every stored embedding carries its fingerprint.

    Attributes
    ----------
    name : str
        The name that people use; not part of the fingerprint.
    mesh : MeshParameters
    sampling : SamplingParameters
    spectral : SpectralParameters
    matching : MatchingParameters
    ranking : RankingParameters

    Notes
    -----
    The names of parameters are unique across groups. JSON objects hold either the groups, or all parameters
    side by side with the keys of `FLAT_KEYS`, as databases and files of earlier versions do.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    name: str = "default"
    mesh: MeshParameters = MeshParameters()
    sampling: SamplingParameters = SamplingParameters()
    spectral: SpectralParameters = SpectralParameters()
    matching: MatchingParameters = MatchingParameters()
    ranking: RankingParameters = RankingParameters()

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
            raise ValueError(
                "first_dimensions must be at most 6 and at most dimensions, or equal to dimensions if "
                "sign_starts is false"
            )
        return self

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> Self:
        """Parameters from flat keys, from groups, or from both; the others have the defaults.

        Raises
        ------
        ParameterError
            An unknown or repeated parameter, a wrong type, or a value out of its range.
        """
        try:
            return cls.model_validate(_grouped(values))
        except ValidationError as error:
            raise ParameterError("; ".join(_explained(one) for one in error.errors())) from error

    def with_values(self, **values: object) -> Self:
        """These parameters with other values, given by the parameters' names or flat keys.

        Raises
        ------
        ParameterError
            See `from_values`.
        """
        changed = {FLAT_KEYS.get(name, name): value for name, value in values.items()}
        return self.from_values({**self.flat(), **changed})

    def flat(self) -> dict[str, Any]:
        """All parameters side by side, by the keys of `FLAT_KEYS`, and the name."""
        groups = (getattr(self, group).model_dump(by_alias=True) for group in GROUPS)
        return {"name": self.name} | {key: value for group in groups for key, value in group.items()}

    @cached_property
    def fingerprint(self) -> str:
        """Sixteen hexadecimal digits: a hash of the parameters and of the method version."""
        flat = self.flat()
        left_out = {"name", *(key for key, earlier in EARLIER_VALUES.items() if flat[key] == earlier)}
        values = {key: value for key, value in flat.items() if key not in left_out}
        text = json.dumps({"method": METHOD_VERSION, **values}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def to_json(self) -> str:
        """All parameters as a JSON object of groups."""
        return self.model_dump_json(indent=2)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Parameters from a JSON object of groups or of flat keys; the others have the defaults.

        Raises
        ------
        ParameterError
            Not a JSON object, or not valid: see `from_values`.
        """
        try:
            values = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ParameterError(f"not JSON: {error}") from error
        if not isinstance(values, dict):
            raise ParameterError("parameters must be a JSON object")
        return cls.from_values(values)


def _grouped(values: Mapping[str, Any]) -> dict[str, Any]:
    """The values with each flat key moved into its group."""
    grouped = {key: value for key, value in values.items() if key not in _PLACES}
    for key in (key for key in values if key in _PLACES):
        group, name = _PLACES[key]
        members = grouped.get(group, {})
        if isinstance(members, BaseModel):
            members = members.model_dump(exclude_unset=True)
        if isinstance(members, Mapping):
            if name in members:
                raise ParameterError(f"{name} is given more than once")
            grouped[group] = {**members, name: values[key]}
    return grouped


def _explained(error: Mapping[str, Any]) -> str:
    """The parameter and the cause of one of pydantic's errors."""
    where = ".".join(str(part) for part in error["loc"])
    if error["type"] == "extra_forbidden":
        return f"unknown parameter {where!r}; known are name, {', '.join(FLAT_KEYS)}"
    if error["type"] == "value_error":
        return str(error["ctx"]["error"])
    return f"{where}: {error['msg'][0].lower()}{error['msg'][1:]}"


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
        normalise_weights=False,
        selection="sort-and-cut",
        samples=0,
        tau=0.3,
        sample_cap=400,
        points=0,
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
        orientation=False,
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
    ranking=RankingParameters(
        global_descriptors=False,
        spin_images=False,
        views=False,
    ),
)
"""As literal as the text allows, with the errata of the page docs/method.md."""
