"""The effect of each step from the paper's setting to the default one on retrieval.

    python -m tests.studies.ablation DIR COLLECTION... [--without] [--limit 38]

ablation.csv has NN, FT and ST of `paper` with each change alone, of the changes one after another, and, with
--without, of `default` without each change. A collection takes about twenty evaluations.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from core.parameters import DEFAULT, PAPER, Parameters
from service.evaluation.retrieval import collection_files, evaluate_ranking, score_collection
from service.search.schemas import RankBy
from tests.studies.common import run, write

MEASURES = ("nn", "ft", "st")


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
            *("dimensions", "first_dimensions", "sign_starts", "kept_starts", "start_iterations"),
            *("step_iterations", "search_samples", "search_dimensions"),
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

LAST = Change("ranked by combined, which reads all descriptors", (), "combined")
"""The step that affects the ranking only; it changes no parameter."""


@dataclass(frozen=True)
class Trial:
    """One line of the table: `parameters` ranked by `rank_by`."""

    block: str
    title: str
    parameters: Parameters
    rank_by: RankBy


def changes() -> tuple[Change, ...]:
    """Return the steps: `NAMED`, a step for any parameter that they leave out, and `LAST`."""
    named = {name for change in NAMED for name in change.fields}
    default, paper = values_of(DEFAULT), values_of(PAPER)
    rest = tuple(name for name in default if name not in named and paper[name] != default[name])
    left_out = (Change(f"the rest of default: {', '.join(rest)}", rest),) if rest else ()
    return (*NAMED, *left_out, LAST)


def trials(*, without: bool = False) -> list[Trial]:
    """Return `paper`, each change on it alone, the changes added up, and `default` without each change."""
    alone, together = ([Trial(block, "paper", PAPER, "cc")] for block in ("alone", "together"))
    left_out = [Trial("without", f"default by {by}", DEFAULT, by) for by in ("cc", LAST.rank_by)]
    so_far = PAPER
    for step in changes():
        so_far = taken(so_far, DEFAULT, step)
        together.append(Trial("together", step.title, so_far, step.rank_by))
        alone.append(Trial("alone", step.title, taken(PAPER, DEFAULT, step), step.rank_by))
        if step.fields:
            left_out.append(Trial("without", step.title, taken(DEFAULT, PAPER, step), step.rank_by))
    return [*alone, *together, *(left_out if without else [])]


def taken(parameters: Parameters, source: Parameters, change: Change) -> Parameters:
    """Return the parameters with the fields of a change as they are in `source`."""
    groups: dict[str, dict[str, object]] = {}
    for name in change.fields:
        group, value = values_of(source)[name]
        groups.setdefault(group, {})[name] = value
    return parameters.with_values(**groups)


def values_of(parameters: Parameters) -> dict[str, tuple[str, object]]:
    """Return the group and the value of each parameter, by name."""
    groups = parameters.model_dump(exclude={"name"}).items()
    return {name: (group, value) for group, values in groups for name, value in values.items()}


def main(
    folder: Path, collections: list[Path], without: bool, limit: int | None, workers: int | None
) -> None:
    """Measure each set of parameters once on each collection."""
    rows: list[dict[str, Any]] = []
    for collection in collections:
        known = {}
        for trial in trials(without=without):
            fingerprint = trial.parameters.fingerprint
            if fingerprint not in known:
                files = collection_files(collection, limit)
                known[fingerprint] = score_collection(files, trial.parameters, workers)
            labels, scores = known[fingerprint]
            figures = evaluate_ranking(scores, labels, trial.rank_by)
            row = {"collection": collection.name, "block": trial.block, "row": trial.title}
            row |= {"rank_by": trial.rank_by, "fingerprint": fingerprint}
            rows.append(row | {name: getattr(figures, name) for name in MEASURES})
    write(folder / "ablation.csv", rows, digits=3)


if __name__ == "__main__":
    run(main, __doc__, collections="folders", without=False, limit=int, workers=int)
