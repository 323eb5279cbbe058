"""The curves of the paper's Fig. 9, and pictures of the perturbations."""

from io import BytesIO
from itertools import groupby

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from core.gallery import make_shape
from core.studies.robustness import KINDS, Level, RobustnessStudy
from service.rendering.drawing import Panel, draw_grid
from service.studies.robustness.table import TITLES, UNITS, amount_of

_COLOURS = {"cc": "#0072b2", "combined": "#d55e00", "part": "#009e73"}
_NAMES = {"cc": "by cc", "combined": "by combined", "part": "as a part"}
_COLUMNS = 4
SHOWN = "person"


def curves_figure(study: RobustnessStudy) -> bytes:
    """A PNG with one chart per perturbation: NN against amount, with bars over the range of the seeds."""
    kinds = [(kind, list(levels)) for kind, levels in groupby(study.levels, key=lambda level: level.kind)]
    height = -(-len(kinds) // _COLUMNS)
    width = min(len(kinds), _COLUMNS)
    figure = Figure(figsize=(2.9 * width + 0.6, 2.7 * height + 0.7), layout="constrained")
    grid = figure.subplots(height, width, sharey=True, squeeze=False)
    for axes in grid.flat[len(kinds) :]:
        axes.set_axis_off()
    for axes, (kind, levels) in zip(grid.flat, kinds, strict=False):
        _curves(axes, study, levels)
        axes.set_title(TITLES[kind], fontsize=9)
        axes.set_xlabel(UNITS[kind], fontsize=8)
    for row in grid:
        row[0].set_ylabel("NN", fontsize=8)
    grid[0, 0].set_ylim(0.0, 1.02)
    known = {
        name: handle
        for axes in grid.flat
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        known.values(), known, loc="outside lower center", ncols=min(5, 2 * width), fontsize=8, frameon=False
    )
    data = BytesIO()
    # Without the version of Matplotlib, so that equal pictures have equal bytes.
    figure.savefig(data, format="png", dpi=88, metadata={"Software": None}, pil_kwargs={"optimize": True})
    return data.getvalue()


def shapes_figure() -> bytes:
    """A PNG with one generated shape under the strongest amount of every kind."""
    mesh = make_shape(SHOWN, 0)
    panels = [Panel(mesh, "clean")]
    panels += [
        Panel(
            kind.perturb(mesh, kind.amounts[-1], 0), f"{kind.title}\n{100 * kind.amounts[-1]:g} {kind.unit}"
        )
        for kind in KINDS
    ]
    return draw_grid([panels[i : i + _COLUMNS] for i in range(0, len(panels), _COLUMNS)])


def _curves(axes: Axes, study: RobustnessStudy, levels: list[Level]) -> None:
    places = range(len(levels))
    for rank_by, colour in _COLOURS.items():
        if any(getattr(run, rank_by) is None for run in levels[0].runs):
            continue
        ends = [level.ends(rank_by) for level in levels]
        means = [mean for mean, _, _ in ends]
        bars = [[mean - least for mean, least, _ in ends], [most - mean for mean, _, most in ends]]
        clean = getattr(study.clean, rank_by)
        if clean is not None:
            axes.axhline(clean, color=colour, linestyle=":", linewidth=1, label=f"{rank_by}, clean")
        axes.errorbar(
            places, means, yerr=bars, color=colour, marker="o", markersize=4, capsize=3, label=_NAMES[rank_by]
        )
    axes.set_xticks(places, [amount_of(level) for level in levels])
    axes.set_xlim(-0.3, len(levels) - 0.7)
    axes.tick_params(labelsize=8)
