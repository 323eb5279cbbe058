"""The reliability diagram."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from core.evaluation.calibration import BINS, Reliability
from service.rendering.drawing import png
from service.studies.calibration.study import CalibrationStudy

_COLOUR = "#0072b2"


def reliability_figure(study: CalibrationStudy) -> bytes:
    """A PNG: for all collections together and for each, the share of one class by the probability given."""
    panels = [("all together", study.together)]
    panels += [(one.name, one.reliability) for one in study.collections]
    figure = Figure(figsize=(3.1 * len(panels), 4.2), layout="constrained")
    grid = figure.subplots(2, len(panels), squeeze=False, sharex=True, height_ratios=(3, 1))
    for column, (title, found) in enumerate(panels):
        _diagram(grid[0, column], title, found)
        _histogram(grid[1, column], found)
    grid[0, 0].set_ylabel("share of one class", fontsize=8)
    grid[1, 0].set_ylabel("share of pairs", fontsize=8)
    return png(figure)


def _diagram(axes: Axes, title: str, found: Reliability) -> None:
    held = found.share > 0.0
    axes.plot([0.0, 1.0], [0.0, 1.0], color="0.6", linewidth=1)
    axes.axhline(found.base_rate, color="0.6", linestyle=":", linewidth=1)
    axes.plot(found.said[held], found.found[held], color=_COLOUR, marker="o", markersize=4)
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.02))
    axes.set_title(f"{title}: error {found.error:.3f}", fontsize=9)
    axes.tick_params(labelsize=8)


def _histogram(axes: Axes, found: Reliability) -> None:
    places = [(i + 0.5) / BINS for i in range(BINS)]
    axes.bar(places, found.share, width=0.9 / BINS, color=_COLOUR)
    axes.set_yscale("log")
    axes.set_xlabel("combined", fontsize=8)
    axes.tick_params(labelsize=8)
