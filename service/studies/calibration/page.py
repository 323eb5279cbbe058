"""The calibration as a page in Markdown, and as the lines of code it comes to."""

from textwrap import fill

from core.evaluation.calibration import BINS, Reliability
from core.ranking.class_probability import Calibration
from service.studies.calibration.study import UPPER, Study

DIGITS = 4

_BINS = ("combined", "share of pairs", "mean given", "found of one class")

COLUMNS = (
    "collection", "shapes", "classes",
    "base rate", "error", f"error above {UPPER / BINS:g}",
    "NN", "FT", "ST",
)  # fmt: skip


def constants(study: Study) -> str:
    """The assignments that `core/ranking/class_probability.py` holds."""
    models = {
        "CALIBRATED": study.model,
        "CALIBRATED_PARTS": study.incomplete.model,
        "WITHOUT_PATCHES": study.without_spin_images,
    }
    return "\n".join(f"{name} = {_constant(model)}" for name, model in models.items())


def _constant(model: Calibration) -> str:
    slopes = ", ".join(f"{slope:.{DIGITS}f}" for slope in model.slopes)
    slopes += "," if len(model.slopes) == 1 else ""
    return f"Calibration(intercept={model.intercept:.{DIGITS}f}, slopes=({slopes}))"


def summary(study: Study) -> list[tuple[str, ...]]:
    """A row for all collections together, and one for each."""
    rows: list[tuple[str, ...]] = [("all together", "", "", *_errors(study.together), "", "", "")]
    for one in study.collections:
        figures = tuple(f"{getattr(one.figures, name):.3f}" for name in ("nn", "ft", "st"))
        rows.append((one.name, str(one.shapes), str(one.classes), *_errors(one.reliability), *figures))
    return rows


def page(study: Study, command: str) -> str:
    """The text of calibration.md, beside its picture; `command` is what made it."""
    parts = [
        "# Calibration of `combined`",
        f"Written by `{command}`. `combined` is the chance that two shapes are of one class: a "
        "logistic model of three numbers made of CC and the Laplace-Beltrami spectra, of terms of form, and "
        "of what lies about points of the surfaces, fitted to all pairs of these collections, each with the "
        "same weight. Pairs with an incomplete shape have a model of their own, of one number. Where what "
        "lies about points is not known, as in the rough steps of a search, a third serves. Their "
        "parameters, in `core/ranking/class_probability.py`:",
        f"```python\n{constants(study)}\n```",
        "What follows is judged without the class in question: the pairs of each class' shapes with all "
        "others, by a model fitted to the pairs without any shape of that class, in any collection.",
        "![Reliability](calibration.png)",
        "*Above: among pairs given about the same chance, how many are of one class; the line is what should "
        "be, dotted the base rate. Below: how many pairs.*",
        _table(COLUMNS, summary(study)),
        "**base rate**: the share of all pairs that are of one class. **error**: the expected calibration "
        f"error, the mean over pairs of how far the share found in its bin of {BINS} is from the mean chance "
        "given. Most pairs are plainly of two classes, so it is told apart for the pairs given more than "
        f"{UPPER / BINS:g}. **NN, FT, ST**: retrieval by those chances.",
        "A class is wider in one collection than in another (all chairs, or one body's poses), and one model "
        "serves all: each alone strays further than all together.",
        "A chance hangs on the base rate: in an archive where fewer pairs are of one class than here, "
        "`combined` is too high, by about the ratio of the odds. Its order is the same.",
        _table(_BINS, _bins(study.together)),
        "## Incomplete shapes",
        f"{study.incomplete.queries} queries, shapes with holes or with a part cut away, 10 to 40 % of the "
        "area gone, each against the whole ones without its own, and judged as above: error "
        f"{study.incomplete.reliability.error:.4f}, above {UPPER / BINS:g} "
        f"{study.incomplete.reliability.error_above(UPPER):.3f}, base rate "
        f"{study.incomplete.reliability.base_rate:.3f}; the likeliest whole one is of the query's class for "
        f"{study.incomplete.nn:.3f} of them.",
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
