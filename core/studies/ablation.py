"""Ablation: parameter sets between `paper` and `default`, which show the effect of each step."""

from dataclasses import dataclass
from typing import Literal

from core.parameters import DEFAULT, PAPER, Parameters

RankBy = Literal["cc", "combined"]
Block = Literal["alone", "together", "without"]


@dataclass(frozen=True)
class Change:
    """A step: names of parameters that change together from `paper` to `default`, and the ranking."""

    title: str
    fields: tuple[str, ...]
    rank_by: RankBy = "cc"


NAMED = (
    Change(
        "even mesh: holes closed, long edges split, large meshes simplified, rough meshes smoothed",
        (
            *("fill_holes", "refine_vertices", "refine_simplified", "smooth_above", "smooth_refined"),
            *("decimate_above", "decimate_to", "decimate_pieces_above"),
        ),
    ),
    Change(
        "samples: 100 by weighted farthest-point sampling, terms of Eqs. 11 and 12 normalised",
        ("selection", "coverage_power", "samples", "sample_cap", "normalise_weights"),
    ),
    Change("geodesic distances, across faces", ("distances", "unfold")),
    Change("Gaussian affinity, eigenvalue scaling", ("affinity", "width", "eigenvalue_power")),
    Change("stiff spline", ("stiffness",)),
    Change(
        "progressive dimension, eight signs",
        (
            "dimensions",
            "first_dimensions",
            "sign_starts",
            "kept_starts",
            "start_iterations",
            "step_iterations",
            "search_samples",
            "search_dimensions",
        ),
    ),
    Change("nearest neighbours both ways, orthogonal map", ("pairs", "warp_stiffness")),
    Change("coordinates tapered at the cut", ("taper",)),
    Change(
        "500 points embedded, the samples as quadrature nodes; partners between the samples",
        ("points", "slide_rounds"),
    ),
    Change(
        "second embedding by Laplace-Beltrami; its eigenvalues and global descriptors in the signature",
        ("operators", "affinity_values", "laplacian_values"),
    ),
)
"""The steps, in the order in which they are added up."""

LAST = (Change("ranked by combined, which reads all descriptors", (), "combined"),)
"""The step that affects the ranking only; it changes no parameter."""


@dataclass(frozen=True)
class Row:
    """One line of the table: `parameters` ranked by `rank_by`."""

    block: Block
    title: str
    parameters: Parameters
    rank_by: RankBy


def changes() -> tuple[Change, ...]:
    """The steps from `paper` to `default`: `NAMED`, a step for any parameter they leave out, and `LAST`."""
    named = {name for change in (*NAMED, *LAST) for name in change.fields} | {"name"}
    default, paper = values_of(DEFAULT), values_of(PAPER)
    rest = tuple(key for key in default if key not in named and paper[key] != default[key])
    left_out = (Change(f"the rest of default: {', '.join(rest)}", rest),) if rest else ()
    return (*NAMED, *left_out, *LAST)


def rows(*, without: bool = False) -> tuple[Row, ...]:
    """`paper`, each change on it alone, the changes added up to `default`, each with its ranking.

    Parameters
    ----------
    without : bool
        Whether to add a third block: `default` with each change undone.

    Raises
    ------
    ParameterError
        A single change gives invalid parameters.
    """
    steps = changes()
    found = [Row("alone", "paper", PAPER, "cc")]
    found += [Row("alone", step.title, _taken(PAPER, DEFAULT, step), step.rank_by) for step in steps]
    found.append(Row("together", "paper", PAPER, "cc"))
    so_far = PAPER
    for step in steps:
        so_far = _taken(so_far, DEFAULT, step)
        found.append(Row("together", step.title, so_far, step.rank_by))
    if without:
        blocks: tuple[tuple[RankBy, str], ...] = (
            ("cc", "default"),
            ("combined", "default, ranked by combined"),
        )
        for rank_by, title in blocks:
            found.append(Row("without", title, DEFAULT, rank_by))
            found += [
                Row("without", step.title, _taken(DEFAULT, PAPER, step), rank_by)
                for step in steps
                if step.fields and step.rank_by == rank_by
            ]
    return tuple(found)


def _taken(parameters: Parameters, source: Parameters, change: Change) -> Parameters:
    """The parameters with the change's fields as they are in `source`."""
    groups: dict[str, dict[str, object]] = {}
    for key in change.fields:
        group, value = values_of(source)[key]
        groups.setdefault(group, {})[key] = value
    return parameters.with_values(**groups)


def values_of(parameters: Parameters) -> dict[str, tuple[str, object]]:
    """Return the group and the value of each parameter, by name."""
    groups = parameters.model_dump(exclude={"name"}).items()
    return {name: (group, value) for group, values in groups for name, value in values.items()}
