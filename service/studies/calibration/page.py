"""The calibration as a page in Markdown, and as the lines of code that hold its constants."""

from textwrap import fill

from core.evaluation.calibration import BINS, Reliability
from core.ranking.opinion_pool import Calibration
from service.studies.calibration.study import UPPER, CalibrationStudy

DIGITS = 4

_BINS = ("combined", "share of pairs", "mean given", "share of one class")

COLUMNS = (
    "collection", "shapes", "classes",
    "base rate", "error", f"error above {UPPER / BINS:g}",
    "NN", "FT", "ST",
)  # fmt: skip


def constants(study: CalibrationStudy) -> str:
    """The assignments that `core/ranking/opinion_pool.py` holds."""
    models = {"CALIBRATED_POOL": study.model, "CALIBRATED_PARTS": study.incomplete.model}
    return "\n".join(f"{name} = {_constant(model)}" for name, model in models.items())


def _constant(model: Calibration) -> str:
    slopes = ", ".join(f"{slope:.{DIGITS}f}" for slope in model.slopes)
    slopes += "," if len(model.slopes) == 1 else ""
    return f"Calibration(intercept={model.intercept:.{DIGITS}f}, slopes=({slopes}))"


def summary(study: CalibrationStudy) -> list[tuple[str, ...]]:
    """A row for all collections together, and one for each."""
    rows: list[tuple[str, ...]] = [("all together", "", "", *_errors(study.together), "", "", "")]
    for one in study.collections:
        figures = tuple(f"{getattr(one.figures, name):.3f}" for name in ("nn", "ft", "st"))
        rows.append((one.name, str(one.shapes), str(one.classes), *_errors(one.reliability), *figures))
    return rows


def page(study: CalibrationStudy, command: str) -> str:
    """The text of calibration.md, beside its picture; `command` is the command that made it."""
    parts = [
        "# Calibration of `combined`",
        f"Written by `{command}`. `combined` is the probability that two shapes have the same class. The log "
        "odds are those of two experts, mixed by the reliability of the shapes' intrinsic description "
        "(`core.descriptors.reliability`): one is linear in logarithms of the differences in CC, sim, global "
        "descriptors and spin images, which count little between nearly isometric surfaces, the other in the "
        "differences of views. Both read how near the seventh neighbours are. The models are fitted to all "
        "pairs of these collections, each collection with the same weight. Pairs with an incomplete shape "
        "have a model of their own. The parameters, in `core/ranking/opinion_pool.py`:",
        f"```python\n{constants(study)}\n```",
        "The model is judged on classes that it has not seen: the pairs of each class' shapes with all other "
        "shapes are judged by a model fitted to the pairs without any shape of that class, in any "
        "collection.",
        "![Reliability](calibration.png)",
        "*Above: the share of pairs of one class among the pairs that are given about the same probability. "
        "The line is perfect calibration; the dotted line is the base rate. Below: the number of pairs.*",
        _table(COLUMNS, summary(study)),
        "**base rate**: the share of all pairs that have one class. **error**: the expected calibration "
        f"error. The probabilities fall into {BINS} bins; the error is the mean over pairs of the difference "
        "between the share of one class found in the bin and the mean probability given there. Most pairs "
        f"clearly have two classes, so the error of the pairs given more than {UPPER / BINS:g} is also "
        "shown. **NN, FT, ST**: retrieval by these probabilities.",
        "Classes are wider in one collection (all chairs) than in another (the poses of one body). One model "
        "serves both, so the error of each collection is larger than the error of all together.",
        "A probability depends on the base rate: in an archive where fewer pairs have one class than here, "
        "`combined` is too high, by about the ratio of the odds. The order of results stays the same.",
        _table(_BINS, _bins(study.together)),
        "## Incomplete shapes",
        f"{study.incomplete.queries} queries with holes or with a part cut away, 10 to 40 % of the area "
        "removed, each against all whole shapes but its own. Judged as above: error "
        f"{study.incomplete.reliability.error:.4f}, above {UPPER / BINS:g} "
        f"{study.incomplete.reliability.error_above(UPPER):.3f}, base rate "
        f"{study.incomplete.reliability.base_rate:.3f}; the most probable whole shape has the query's class "
        f"for {study.incomplete.nn:.3f} of them.",
        _table(_BINS, _bins(study.incomplete.reliability)),
    ]
    wrapped = (part if part[0] in "#`!|" else fill(part, 110, break_on_hyphens=False) for part in parts)
    return "\n\n".join(wrapped) + "\n"


def _errors(found: Reliability) -> tuple[str, str, str]:
    return f"{found.base_rate:.3f}", f"{found.error:.4f}", f"{found.error_above(UPPER):.3f}"


def _bins(found: Reliability) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for i in range(BINS):
        told = (f"{found.said[i]:.3f}", f"{found.found[i]:.3f}") if found.share[i] > 0.0 else ("", "")
        rows.append((f"{i / BINS:.1f} to {(i + 1) / BINS:.1f}", f"{100.0 * found.share[i]:.2f} %", *told))
    return rows


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    rules = ("---", *["---:"] * (len(head) - 1))
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, rules, *rows))
