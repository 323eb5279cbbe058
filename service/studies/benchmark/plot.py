"""The plot of cost against size."""

from collections.abc import Sequence
from io import BytesIO

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from service.studies.benchmark.growth import FORMATS, GrowthRow, exponent


def growth_plot(rows: Sequence[GrowthRow]) -> bytes:
    """Seconds, and peak memory, against vertices on logarithmic scales, as PNG."""
    shown = [row for row in rows if row.format == FORMATS[0]]
    sizes = [row.vertices for row in shown]
    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    FigureCanvasAgg(figure)
    time, memory = figure.subplots(1, 2)
    middle = [row.seconds.median for row in shown]
    below = [row.seconds.median - row.seconds.low for row in shown]
    above = [row.seconds.high - row.seconds.median for row in shown]
    time.errorbar(sizes, middle, yerr=[below, above], marker="o", color="black", capsize=3)
    time.plot(
        sizes,
        [middle[0] * size / sizes[0] for size in sizes],
        color="0.6",
        linestyle="--",
        label="in proportion",
    )
    time.set(xlabel="vertices", ylabel="seconds", xscale="log", yscale="log")
    time.set_title(f"bytes to embedding: n to the power {exponent(rows):.2f}", fontsize=10)
    time.legend(frameon=False)
    memory.plot(sizes, [row.peak_bytes / 2**20 for row in shown], marker="o", color="black")
    memory.set(xlabel="vertices", ylabel="MiB", xscale="log", ylim=(0.0, None))
    memory.set_title("peak memory of the process", fontsize=10)
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()
