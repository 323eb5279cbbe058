"""The paper's Figs. 2 and 3, drawn from our measurements."""

from collections.abc import Sequence
from io import BytesIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from core.arrays import Floats
from core.studies.sampling.measures import BINS, distance_histogram, fit_residuals
from core.studies.sampling.robustness import DELTAS, ROBUST_TAU, noisy
from core.studies.sampling.study import ShapeMeasures
from core.studies.sampling.surface import METHODS, OURS, SamplingMethod, Surface
from core.studies.sampling.trials import COMPARED_TAU, CURVE_TAUS, DEGREES, TAUS
from service.studies.sampling.picture import Picture
from service.studies.sampling.tables import title_of

_DPI = 88
_COLOURS = {
    "cut": "#d55e00",
    "draw": "#e69f00",
    "covering": "#0072b2",
    "poisson-disk": "#222222",
    "farthest-point": "#009e73",
}
_SHOWN = (SamplingMethod("cut", printed=True), SamplingMethod("cut"), SamplingMethod("covering"))
"""The methods in the figures of noise and poses: the paper's selection and the default one."""


def fit_figure(surface: Surface, shapes: Sequence[ShapeMeasures]) -> bytes:
    """Fig. 2: residuals by degree on one shape, and the error by degree of all."""
    figure = Figure(figsize=(11, 3.8), layout="constrained")
    *panels, chart = figure.subplots(1, len(DEGREES) + 1, width_ratios=[1] * len(DEGREES) + [1.3])
    picture = Picture.of(surface.mesh)
    everywhere = np.arange(len(surface.mesh.vertices))
    residuals = [np.abs(fit_residuals(surface.mesh.vertices, degree)) for degree in DEGREES]
    largest = float(np.quantile(residuals[0], 0.98)) or 1.0
    for axes, degree, residual in zip(panels, DEGREES, residuals, strict=True):
        picture.draw(axes, everywhere, size=7, values=np.minimum(residual / largest, 1.0))
        axes.set_title(f"degree {degree}", fontsize=9)
    bar = figure.colorbar(panels[0].collections[-1], ax=panels, location="bottom", shrink=0.4, aspect=30)
    bar.set_ticks([0, 1], labels=["0", f"{largest:.2g} and over"], fontsize=8)
    bar.set_label("|z - f(x, y)| / scale", fontsize=8)
    for shape in shapes:
        chart.plot(DEGREES, shape.fit_errors, color="0.6", linewidth=1, marker="o", markersize=3)
    errors = np.array([shape.fit_errors for shape in shapes])
    chart.plot(DEGREES, errors.mean(axis=0), color="black", linewidth=2.5, marker="o")
    chart.set(xticks=DEGREES, xlabel="degree", ylabel="RMS residual / scale")
    chart.set_ylim(0.0, 1.1 * float(errors.max()) or 1.0)
    if len(shapes) > 1:
        chart.set_title(f"{len(shapes)} shapes, and their mean", fontsize=9)
    return _png(figure)


def ratio_figure(surface: Surface) -> bytes:
    """Fig. 3a: samples at three sparse ratios, by every selection that reads Lewis weights."""
    figure = Figure(figsize=(9, 2.7 * len(OURS)), layout="constrained")
    grid = figure.subplots(len(OURS), len(TAUS) + 1, width_ratios=[1] * len(TAUS) + [1.5])
    picture = Picture.of(surface.mesh)
    whole = distance_histogram(surface.distances)
    for row, method in zip(grid, OURS, strict=True):
        histograms = []
        for axes, tau in zip(row, TAUS, strict=False):
            samples = surface.select(method, surface.count(tau))
            picture.draw(axes, samples, size=6)
            axes.set_title(f"{title_of(method)}\ntau {tau}", fontsize=8)
            histograms.append(distance_histogram(surface.between(samples)))
        _bars(row[-1], histograms, [f"tau {tau}" for tau in TAUS], ["#9ecae1", "#4292c6", "#08306b"], whole)
    return _png(figure)


def methods_figure(surface: Surface, shapes: Sequence[ShapeMeasures]) -> bytes:
    """Fig. 3b: all methods with equally many samples, their histograms, and errors of the rebuilt surface."""
    figure = Figure(figsize=(10, 10.5), layout="constrained")
    halves = figure.add_gridspec(2, 1, height_ratios=[2, 0.9])
    top, bottom = figure.add_subfigure(halves[0]), figure.add_subfigure(halves[1])
    picture = Picture.of(surface.mesh)
    histogram, curve = bottom.subplots(1, 2)
    for i, (axes, method) in enumerate(zip(top.subplots(2, len(METHODS) // 2).flat, METHODS, strict=True)):
        samples = surface.select(method, surface.count(COMPARED_TAU))
        picture.draw(axes, samples, size=8)
        axes.set_title(title_of(method), fontsize=9)
        style = {
            "color": _COLOURS[method.way],
            "linestyle": ":" if method.printed else "-",
            "marker": "o",
            "markersize": 3,
            "label": title_of(method),
        }
        shares = distance_histogram(surface.between(samples))
        histogram.plot(_middles(), 100 * shares, **style)
        errors = np.mean([shape.quality[i].rebuilt_errors for shape in shapes], axis=0)
        curve.plot(CURVE_TAUS, errors, **style)
    histogram.set(xlabel="geodesic distance / largest", ylabel="pairs, %", xlim=(0, 1), xticks=_edges())
    histogram.set_title(f"the shape above, {len(samples)} samples each", fontsize=9)
    curve.set(xscale="log", yscale="log", xlabel="tau", ylabel="error of the rebuilt surface / scale")
    curve.set_xticks(CURVE_TAUS, [f"{tau:g}" for tau in CURVE_TAUS])
    curve.minorticks_off()
    curve.set_title(f"mean of {len(shapes)}" if len(shapes) > 1 else "the shape above", fontsize=9)
    bottom.legend(*curve.get_legend_handles_labels(), loc="outside right center", fontsize=8, frameon=False)
    return _png(figure)


def noise_figure(surface: Surface) -> bytes:
    """Fig. 3c: samples of one shape, clean and under three amounts of noise."""
    columns = [("no noise", surface)]
    columns += [(f"noise {100 * delta:g} %", noisy(surface, delta)) for delta in DELTAS]
    return _columns(columns, ["#bdbdbd", "#9ecae1", "#4292c6", "#08306b"])


def poses_figure(poses: Sequence[Surface]) -> bytes:
    """Fig. 3c: samples of one body in the first four of its poses."""
    columns = [(f"pose {i + 1}", pose) for i, pose in enumerate(poses[:4])]
    return _columns(columns, ["#9ecae1", "#4292c6", "#2171b5", "#08306b"])


def _columns(columns: Sequence[tuple[str, Surface]], colours: Sequence[str]) -> bytes:
    figure = Figure(figsize=(11, 3.0 * len(_SHOWN)), layout="constrained")
    grid = figure.subplots(len(_SHOWN), len(columns) + 1, width_ratios=[1] * len(columns) + [1.5])
    pictures = [Picture.of(surface.mesh) for _, surface in columns]
    for row, method in zip(grid, _SHOWN, strict=True):
        histograms = []
        for axes, picture, (name, surface) in zip(row, pictures, columns, strict=False):
            samples = surface.select(method, surface.count(ROBUST_TAU))
            picture.draw(axes, samples, size=5)
            axes.set_title(f"{title_of(method)}\n{name}", fontsize=8)
            histograms.append(distance_histogram(surface.between(samples)))
        _bars(row[-1], histograms, [name for name, _ in columns], colours)
    return _png(figure)


def _bars(
    axes: Axes,
    histograms: Sequence[Floats],
    names: Sequence[str],
    colours: Sequence[str],
    whole: Floats | None = None,
) -> None:
    """Histograms side by side, with the histogram of all vertices as a line."""
    width = 0.9 / BINS / len(histograms)
    for i, (histogram, name, colour) in enumerate(zip(histograms, names, colours, strict=False)):
        shift = (i - (len(histograms) - 1) / 2) * width
        axes.bar(_middles() + shift, 100 * histogram, width, color=colour, label=name)
    if whole is not None:
        axes.stairs(100 * whole, _edges(), color="#d55e00", linewidth=1.2, label="all vertices")
    axes.set_xticks(_edges())
    axes.tick_params(labelsize=7)
    axes.set_xlabel("geodesic distance / largest", fontsize=7)
    axes.set_ylabel("pairs, %", fontsize=7)
    axes.legend(fontsize=7, frameon=False)


def _edges() -> Floats:
    return np.linspace(0.0, 1.0, BINS + 1)


def _middles() -> Floats:
    return (np.arange(BINS) + 0.5) / BINS


def _png(figure: Figure) -> bytes:
    data = BytesIO()
    # Without the version of Matplotlib, so that equal pictures have equal bytes.
    figure.savefig(data, format="png", dpi=_DPI, metadata={"Software": None}, pil_kwargs={"optimize": True})
    return data.getvalue()
