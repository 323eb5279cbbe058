"""Retrieval of perturbed queries as a table of text."""

from core.studies.robustness import KINDS, TAU, TAU_VERTICES, Level, RobustnessStudy
from service.studies.sampling.tables import TextTable

TITLES = {TAU: "sparse ratio tau", **{kind.name: kind.title for kind in KINDS}}
# The clean ranking from which each loss is measured; clean partial queries do not exist.
CLEAN = {"cc": "cc", "combined": "combined", "part": "combined"}
UNITS = {TAU: f"of about {TAU_VERTICES} vertices", **{kind.name: kind.unit for kind in KINDS}}


def amount_of(level: Level) -> str:
    """The amount as text: tau as a number, all other amounts in per cent."""
    return f"{level.amount:g}" if level.kind == TAU else f"{100 * level.amount:g}"


def table(study: RobustnessStudy) -> TextTable:
    """NN by CC, by the combined score and of parts, with the loss in points against clean queries."""
    rows: list[tuple[str, ...]] = [
        ("none", "", f"{study.clean.cc:.3f}", "", f"{study.clean.combined:.3f}", *[""] * 5)
    ]
    rows += [_row(study, level) for level in study.levels]
    return TextTable(
        f"{study.collection}: {study.shapes} shapes, {study.classes} classes, {study.seeds} seed(s)",
        (
            "perturbation",
            "amount",
            "NN cc",
            "fall",
            "NN combined",
            "fall",
            "NN as a part",
            "fall",
            "own CC",
            "unusable",
        ),
        tuple(rows),
        "NN is the mean over the seeds, with the smallest and the largest in brackets. The fall is in "
        "points; NN as a part falls from the clean queries by the combined score.",
    )


def _row(study: RobustnessStudy, level: Level) -> tuple[str, ...]:
    cells = []
    for rank_by, clean in CLEAN.items():
        if any(getattr(run, rank_by) is None for run in level.runs):
            cells += ["", ""]
            continue
        clean_nn = getattr(study.clean, clean)
        mean, least, most = level.ends(rank_by)
        spread = f" ({least:.2f}–{most:.2f})" if len(level.runs) > 1 else ""
        cells += [f"{mean:.3f}{spread}", f"{100 * (clean_nn - mean):.1f}"]
    own = f"{sum(level.own_cc) / len(level.own_cc):.3f}" if level.own_cc else ""
    bad = str(max(level.unusable)) if any(level.unusable) else ""
    amount = f"{amount_of(level)} {UNITS[level.kind]}"
    return TITLES[level.kind], amount, *cells, own, bad
