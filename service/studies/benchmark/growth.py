"""Time and memory of an embedding against the size of the mesh, each measured in a new process."""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from core.io import format_of, write_mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from service.studies.benchmark.meshes import Source, resized
from service.studies.benchmark.stages import embed_bytes
from service.studies.benchmark.timing import Spread, growth_exponent

SIZES = (3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
REPEATS = 3
FORMATS = ("ply", "stl", "glb")


@dataclass(frozen=True)
class GrowthRow:
    """The cost of one size in one format.

    Attributes
    ----------
    vertices, faces, file_bytes : int
    format : str
    seconds : Spread
        From bytes to embedding.
    stages : dict of str to float
        Medians, in seconds.
    peak_bytes : int
        Peak memory of the process, libraries included.
    """

    vertices: int
    faces: int
    file_bytes: int
    format: str
    seconds: Spread
    stages: dict[str, float]
    peak_bytes: int


def peak_memory() -> int:
    """The peak memory of this process, in bytes.

    Not from getrusage, which counts what the parent held when it forked.
    """
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.split("VmHWM:")[1].split()[0])


def measure_file(path: str, repeats: int) -> tuple[list[dict[str, float]], int]:
    """Embed a file several times in this process: seconds by stage for each run, and the peak memory."""
    data = Path(path).read_bytes()
    method = Pipeline(DEFAULT)
    return [embed_bytes(method, data, format_of(path))[1] for _ in range(repeats)], peak_memory()


def growth_rows(
    source: Source, folder: Path, *, sizes: Sequence[int] = SIZES, repeats: int = REPEATS
) -> list[GrowthRow]:
    """Measure one mesh at each size as PLY, and the largest in every format, with files in a folder."""
    _, mesh = (source.of("fourleg") or source.nearest(sizes[0], 1))[0]
    rows = []
    for size in sizes:
        scaled = resized(mesh, size)
        for format in FORMATS if size == sizes[-1] else FORMATS[:1]:
            path = folder / f"{size}.{format}"
            path.write_bytes(write_mesh(scaled, format))
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
                found, peak = pool.submit(measure_file, str(path), repeats).result()
            rows.append(
                GrowthRow(
                    vertices=len(scaled.vertices),
                    faces=len(scaled.faces),
                    file_bytes=path.stat().st_size,
                    format=format,
                    seconds=Spread.of([sum(stages.values()) for stages in found]),
                    stages={name: float(np.median([one[name] for one in found])) for name in found[0]},
                    peak_bytes=peak,
                )
            )
            path.unlink()
    return rows


def exponents(rows: Sequence[GrowthRow]) -> tuple[float, float]:
    """The exponents of seconds and of peak memory as powers of the number of vertices, over the PLY files."""
    shown = [row for row in rows if row.format == FORMATS[0]]
    sizes = [row.vertices for row in shown]
    seconds, memory = [row.seconds.median for row in shown], [row.peak_bytes for row in shown]
    return growth_exponent(sizes, seconds), growth_exponent(sizes, memory)
