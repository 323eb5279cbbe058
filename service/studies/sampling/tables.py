"""The evidence as tables of text, each with a sentence on what it shows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.arrays import Floats
from core.studies.sampling.robustness import DELTAS, ROBUST_TAU
from core.studies.sampling.study import SamplingStudy, ShapeMeasures, variations
from core.studies.sampling.surface import METHODS, OTHERS, OURS, SamplingMethod
from core.studies.sampling.trials import COMPARED_TAU, CURVE_TAUS, DEGREES, TAUS

EXACT = 1e-9
"""A best fit with less error than this part of the scale is exact, and no ratio is taken to it."""

PAPER_METHOD = SamplingMethod("cut", printed=True)
"""The paper's own selection, to the letter."""

_WAYS = {
    "cut": "cut",
    "draw": "draw",
    "covering": "weighted farthest point",
    "poisson-disk": "Poisson disk",
    "farthest-point": "farthest point",
}


@dataclass(frozen=True)
class TextTable:
    """A table: its title, the names of its columns, its rows, and a sentence on what it shows."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    shows: str


def title_of(method: SamplingMethod) -> str:
    """The method's name in tables and pictures."""
    reading = (", printed" if method.printed else ", normalised") if method.weighted else ""
    return _WAYS[method.way] + reading


def percent(shares: Sequence[float] | Floats) -> str:
    """Shares of a histogram as whole per cents."""
    return " ".join(f"{100.0 * share:.0f}" for share in shares)


def all_tables(study: SamplingStudy) -> tuple[TextTable, ...]:
    """Fig. 2, 3a, 3b and 3c; the table of poses only where there are any two shapes to compare."""
    tables = [
        fit_table(study.shapes),
        steadiness_table(study.shapes),
        quality_table(study.shapes),
        rebuilt_table(study.shapes),
        noise_table(study.shapes),
    ]
    if len(study.poses) > 1 or len(study.shapes) > 1:
        tables.append(pose_table(study))
    return tuple(tables)


def fit_table(shapes: Sequence[ShapeMeasures]) -> TextTable:
    """Fig. 2: error of the best fit by degree."""
    errors = np.array([shape.fit_errors for shape in shapes])
    rows = [(shape.name, str(shape.vertices), *_decimals(shape.fit_errors, 4)) for shape in shapes]
    mean = errors.mean(axis=0)
    if len(shapes) > 1:
        rows.append(("mean", "", *_decimals(mean, 4)))
    lost = 100.0 * (1.0 - mean[-1] / mean[0]) if mean[0] > EXACT else 0.0
    return TextTable(
        "Fig. 2: RMS residual of the best fit z = f(x, y), over the shape's scale",
        ("shape", "vertices", *(f"degree {degree}" for degree in DEGREES)),
        tuple(rows),
        f"A higher degree fits better, as the paper says: from {DEGREES[0]} to {DEGREES[-1]} the error falls "
        f"by {lost:.0f} %, to {mean[-1]:.2f} of the scale. No degree makes a closed surface a graph over a "
        "plane: its two sides share x and y.",
    )


def steadiness_table(shapes: Sequence[ShapeMeasures]) -> TextTable:
    """Fig. 3a: histograms by sparse ratio."""
    rows, between = [], []
    for i, method in enumerate(METHODS):
        found = [shape.steadiness[i] for shape in shapes]
        histograms = np.mean([one.histograms for one in found], axis=0)
        between.append(float(np.mean([one.between_taus for one in found])))
        surface = float(np.mean([one.from_surface for one in found]))
        cells = [percent(histogram) for histogram in histograms]
        rows.append((title_of(method), *cells, f"{between[-1]:.3f}", f"{surface:.3f}"))
    whole = percent(np.mean([shape.surface_histogram for shape in shapes], axis=0))
    rows.append(("all vertices", *([whole] * len(TAUS)), "", ""))
    return TextTable(
        "Fig. 3a: pairs of samples in five ranges of normalised geodesic distance, per cent",
        ("selection", *(f"tau {tau}" for tau in TAUS), "between taus", "from surface"),
        tuple(rows),
        f"The change between taus is {_ends(between, 3)}.",
    )


def quality_table(shapes: Sequence[ShapeMeasures]) -> TextTable:
    """Fig. 3b: every method with the same number of samples."""
    rows, gaps = [], []
    for i, method in enumerate(METHODS):
        found = [shape.quality[i] for shape in shapes]
        ratios = [
            one.fit_error / shape.fit_errors[-1]
            for one, shape in zip(found, shapes, strict=True)
            if shape.fit_errors[-1] > EXACT
        ]
        gaps.append(_mean([one.largest_gap for one in found]))
        rows.append(
            (
                title_of(method),
                f"{gaps[-1]:.3f}",
                f"{_mean([one.mean_gap for one in found]):.4f}",
                f"{_mean([one.evenness for one in found]):.2f}",
                percent(np.mean([one.histogram for one in found], axis=0)),
                _ratio(ratios),
            )
        )
    samples = sum(shape.quality[0].samples for shape in shapes)
    return TextTable(
        f"Fig. 3b: methods with the same number of samples (tau {COMPARED_TAU}, {samples} in all)",
        ("selection", "largest gap", "mean gap", "evenness", "histogram", "fit / best"),
        tuple(rows),
        f"The widest gap is {_ends(gaps, 3)}.",
    )


def rebuilt_table(shapes: Sequence[ShapeMeasures]) -> TextTable:
    """Fig. 3b: error of the surface rebuilt from the samples, and how many of Poisson disk do as well."""
    errors = np.mean([[one.rebuilt_errors for one in shape.quality] for shape in shapes], axis=0)
    reference = errors[METHODS.index(OTHERS[0])]
    place = CURVE_TAUS.index(COMPARED_TAU)
    rows = [
        (title_of(method), *_decimals(errors[i], 4), _as_many(errors[i][place], reference))
        for i, method in enumerate(METHODS)
    ]
    ours = errors[: len(OURS), place]
    best = int(np.argmin(ours))
    share, own = (_as_many(float(ours[i]), reference) for i in (best, METHODS.index(PAPER_METHOD)))
    return TextTable(
        "Fig. 3b: RMS distance from the surface to the surface rebuilt from the samples, over the scale",
        ("selection", *(f"tau {tau}" for tau in CURVE_TAUS), "as Poisson disk with"),
        tuple(rows),
        f"At tau {COMPARED_TAU}, the selection by Lewis weight that keeps the surface best is "
        f'"{title_of(METHODS[best])}": Poisson disk has the same error with {share} as many samples. The '
        f'paper\'s own selection, "{title_of(PAPER_METHOD)}", has the same error as Poisson disk with {own} '
        "as many.",
    )


def noise_table(shapes: Sequence[ShapeMeasures]) -> TextTable:
    """Fig. 3c: samples with and without noise."""
    rows, overlaps, evens = [], [], []
    for method in METHODS:
        changes, overlap = [], []
        for delta in DELTAS:
            found = [
                row
                for shape in shapes
                for row in shape.noise
                if (row.method, row.delta) == (method.name, delta)
            ]
            changes.append(_mean([row.histogram_change for row in found]))
            overlap.append(_mean([row.overlap for row in found]))
        evens.append(_mean([row.even_overlap for row in found]))
        overlaps.append(overlap[0])
        rows.append((title_of(method), *_decimals([*changes, *overlap, evens[-1]], 3)))
    heads = [f"{what} {100 * delta:g} %" for what in ("change", "kept") for delta in DELTAS]
    own = METHODS.index(PAPER_METHOD)
    return TextTable(
        f"Fig. 3c: Gaussian noise, tau {ROBUST_TAU}: change of the histogram, and samples kept",
        ("selection", *heads, "kept if even"),
        tuple(rows),
        f"At the paper's noise of {100 * DELTAS[0]:g} % between {100 * min(overlaps):.0f} and "
        f"{100 * max(overlaps):.0f} % of the samples stay in their regions; under {_name(PAPER_METHOD)}, "
        f"{100 * overlaps[own]:.0f} %, where an even spread would share {100 * evens[own]:.0f} %.",
    )


def pose_table(study: SamplingStudy) -> TextTable:
    """Fig. 3c: histograms of one body in several poses, beside those of different shapes."""
    rows, shares = [], []
    for method in METHODS:
        poses, shapes = (variations(group, method.name) for group in (study.poses, study.shapes))
        rows.append((title_of(method), *_pairs(poses), *_pairs(shapes)))
        if len(poses) and len(shapes):
            shares.append(float(poses.mean() / shapes.mean()))
    return TextTable(
        f"Fig. 3c: change of the histogram between poses of one body and between shapes, tau {ROBUST_TAU}",
        ("selection", "poses, mean", "poses, largest", "shapes, mean", "shapes, largest"),
        tuple(rows),
        f"The mean change between poses, over that between shapes, is {_ends(shares, 2)}."
        if shares
        else "Comparing needs poses of one body, and two shapes or more.",
    )


def _decimals(values: Sequence[float] | Floats, digits: int) -> list[str]:
    return [f"{value:.{digits}f}" for value in values]


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))


def _pairs(found: Floats) -> tuple[str, str]:
    return (f"{found.mean():.3f}", f"{found.max():.3f}") if len(found) else ("", "")


def _ratio(ratios: Sequence[float]) -> str:
    """Their median; of shapes that are fitted exactly there is none."""
    if not ratios:
        return "exact"
    median = float(np.median(ratios))
    return f"{median:.2f}" if median < 100.0 else f"{median:.0f}"


def _name(method: SamplingMethod) -> str:
    """The method's name in a sentence."""
    return f"the paper's own, {title_of(method)}" if method == PAPER_METHOD else title_of(method)


def _ends(values: Sequence[float], digits: int) -> str:
    """The methods of the smallest and the largest value, and the paper's where it is neither."""
    order = np.argsort(values, kind="stable").tolist()
    low, high = (f"{_name(METHODS[i])} ({values[i]:.{digits}f})" for i in (order[0], order[-1]))
    own = METHODS.index(PAPER_METHOD)
    between = f", {values[own]:.{digits}f} under {_name(PAPER_METHOD)}" if own in order[1:-1] else ""
    return f"smallest under {low}, largest under {high}{between}"


def _as_many(error: float, reference: Floats) -> str:
    """The samples, over those at `COMPARED_TAU`, with which the reference curve has this error."""
    if not error > 0.0 or not (reference > 0.0).all():
        return ""
    if error < reference.min():
        return f"over {CURVE_TAUS[-1] / COMPARED_TAU:.1f} times"
    if error > reference.max():
        return f"under {CURVE_TAUS[0] / COMPARED_TAU:.1f} times"
    tau = np.exp(np.interp(-np.log(error), -np.log(reference), np.log(CURVE_TAUS)))
    return f"{tau / COMPARED_TAU:.2f} times"
