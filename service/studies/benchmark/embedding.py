"""Time to embed a file of about 3,000 vertices, and LaPy's time for ShapeDNA of the same mesh."""

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

from threadpoolctl import threadpool_limits

from core.io import write_mesh
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from service.studies.benchmark.meshes import Source
from service.studies.benchmark.stages import embed_bytes
from service.studies.benchmark.timing import Spread

VERTICES, MESHES, REPEATS = 3000, 5, 9
PEER_VALUES = 50


@dataclass(frozen=True)
class EmbeddingTimes:
    """The times of one mesh.

    Attributes
    ----------
    name : str
    vertices : int
    seconds : Spread
        From the bytes of a binary PLY to the embedding.
    stages : dict of str to Spread
        The same time by stage.
    peer, ratio : Spread or None
        LaPy's time in seconds, and the ratio of our time to LaPy's in neighbouring measurements.
    """

    name: str
    vertices: int
    seconds: Spread
    stages: dict[str, Spread]
    peer: Spread | None
    ratio: Spread | None


def shapedna() -> Callable[[Mesh], object]:
    """LaPy's ShapeDNA with 50 eigenvalues.

    Raises
    ------
    ImportError
        LaPy is not installed.
    """
    from lapy import TriaMesh  # noqa: PLC0415  optional
    from lapy.shapedna import compute_shapedna  # noqa: PLC0415  optional

    return lambda mesh: compute_shapedna(TriaMesh(mesh.vertices, mesh.faces), k=PEER_VALUES)


def embedding_rows(
    source: Source,
    peer: Callable[[Mesh], object] | None,
    *,
    vertices: int = VERTICES,
    meshes: int = MESHES,
    repeats: int = REPEATS,
) -> list[EmbeddingTimes]:
    """Measure meshes of about a number of vertices, both methods in turn, after one warm-up."""
    method = Pipeline(DEFAULT)
    rows = []
    for name, mesh in source.nearest(vertices, meshes):
        data = write_mesh(mesh, "ply")
        ours: list[dict[str, float]] = []
        theirs: list[float] = []
        for _ in range(repeats + 1):
            ours.append(embed_bytes(method, data, "ply")[1])
            if peer is not None:
                with threadpool_limits(limits=1):
                    start = perf_counter()
                    peer(mesh)
                    theirs.append(perf_counter() - start)
        ours, theirs = ours[1:], theirs[1:]
        whole = [sum(stages.values()) for stages in ours]
        rows.append(
            EmbeddingTimes(
                name=name,
                vertices=len(mesh.vertices),
                seconds=Spread.of(whole),
                stages={stage: Spread.of([one[stage] for one in ours]) for stage in ours[0]},
                peer=Spread.of(theirs) if theirs else None,
                ratio=Spread.of([a / b for a, b in zip(whole, theirs, strict=True)]) if theirs else None,
            )
        )
    return rows
