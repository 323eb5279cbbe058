"""The plots of cost against size."""

from collections.abc import Sequence
from io import BytesIO

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from core.arrays import Floats
from service.studies.benchmark import growth, searching
from service.studies.benchmark.growth import FORMATS, GrowthRow
from service.studies.benchmark.searching import SearchRow


def growth_plot(rows: Sequence[GrowthRow]) -> bytes:
    """Seconds from bytes to embedding, with quartiles, and peak memory, against vertices, as PNG."""
    shown = [row for row in rows if row.format == FORMATS[0]]
    seconds = np.array([(row.seconds.low, row.seconds.median, row.seconds.high) for row in shown])
    memory = [row.peak_bytes for row in shown]
    titles = ("bytes to embedding", "peak memory of the process")
    return _plot("vertices", [row.vertices for row in shown], seconds, memory, titles, growth.exponents(rows))


def search_plot(rows: Sequence[SearchRow]) -> bytes:
    """Seconds of a query, median and 95th percentile, and memory, against shapes, as PNG."""
    shown = searching.by_default(rows)
    seconds = np.array([(row.median, row.median, row.p95) for row in shown])
    memory = [row.memory for row in shown]
    titles = ("a query, and the 95th percentile", "memory of the service")
    return _plot("shapes", [row.shapes for row in shown], seconds, memory, titles, searching.exponents(shown))


def _plot(
    of: str,
    sizes: Sequence[int],
    seconds: Floats,
    memory: Sequence[int],
    titles: tuple[str, str],
    exponents: tuple[float, float],
) -> bytes:
    """Both on logarithmic scales beside a line in proportion to size.

    Parameters
    ----------
    of : str
        What is counted.
    sizes : sequence of int, length n
    seconds : float64, shape (n, 3)
        The low end, the middle and the high end of each size.
    memory : sequence of int, length n
        In bytes.
    titles : tuple of str
    exponents : tuple of float
        Of seconds and of memory.
    """
    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    FigureCanvasAgg(figure)
    low, middle, high = seconds.T
    above = np.array(memory) / 2**20
    ends = np.stack([middle - low, high - middle])
    kinds = ((middle, ends, "seconds"), (above, None, "MiB"))
    for axes, kind, title, exponent in zip(figure.subplots(1, 2), kinds, titles, exponents, strict=True):
        values, spread, unit = kind
        axes.errorbar(sizes, values, yerr=spread, marker="o", color="black", capsize=3)
        proportion = [values[0] * size / sizes[0] for size in sizes]
        axes.plot(sizes, proportion, color="0.6", linestyle="--", label="in proportion")
        axes.set(xlabel=of, ylabel=unit, xscale="log", yscale="log")
        axes.set_title(f"{title}: n to the power {exponent:.2f}", fontsize=9)
        axes.legend(frameon=False)
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()
