"""The paper's Table 1 and our times by stage, on meshes of similar classes and sizes."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

from core.io import write_mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.studies.published_figures import TABLE_1, Times
from service.studies.benchmark.meshes import Source, resized
from service.studies.benchmark.stages import EMBEDDING, SAMPLING, embed_bytes
from service.studies.benchmark.timing import Spread

PAIRS, REPEATS, MATCHES = 2, 5, 20


@dataclass(frozen=True)
class Table1Row:
    """A line of the table.

    Attributes
    ----------
    paper : Times
    vertices : int
        Mean number of vertices of our meshes.
    samples, points : int
        Numbers of matched samples and of all embedded points.
    sampling, embedding, matching : Spread
        Seconds: from the mesh to the samples, with cleaning and simplification; the graph of samples, its
        tree and the spectra; one match in both directions, with factored splines.
    """

    paper: Times
    vertices: int
    samples: int
    points: int
    sampling: Spread
    embedding: Spread
    matching: Spread

    def faster(self) -> tuple[float, float, float]:
        """The ratio of the paper's time to ours, by stage."""
        paper = (self.paper.sampling, self.paper.embedding, self.paper.matching)
        ours = (self.sampling, self.embedding, self.matching)
        return tuple(theirs / mine.median for theirs, mine in zip(paper, ours, strict=True))  # type: ignore[return-value]


def table1_rows(
    source: Source,
    *,
    lines: Sequence[Times] = TABLE_1,
    pairs: int = PAIRS,
    repeats: int = REPEATS,
    matches: int = MATCHES,
) -> list[Table1Row]:
    """Measure pairs of meshes of each line's class, resized to its number of vertices.

    Lines are left out if their class has fewer than two meshes.
    """
    method = Pipeline(DEFAULT)
    rows = []
    for line in lines:
        meshes = [resized(mesh, line.points) for _, mesh in source.of(line.label)[: 2 * pairs]]
        if len(meshes) < 2:
            continue
        stages: list[dict[str, float]] = []
        matching: list[float] = []
        embeddings = []
        for mesh in meshes:
            data = write_mesh(mesh, "ply")
            found = [embed_bytes(method, data, "ply") for _ in range(repeats + 1)]
            embeddings.append(found[0][0])
            stages += [seconds for _, seconds in found[1:]]
        for first, second in zip(embeddings[::2], embeddings[1::2], strict=False):
            for _ in range(matches + 1):
                start = perf_counter()
                method.match(first, second)
                matching.append(perf_counter() - start)
            # The first match factors the splines.
            del matching[-matches - 1]
        rows.append(
            Table1Row(
                paper=line,
                vertices=round(sum(len(mesh.vertices) for mesh in meshes) / len(meshes)),
                samples=len(embeddings[0].positions),
                points=len(embeddings[0].regions),
                sampling=Spread.of([sum(one[name] for name in SAMPLING) for one in stages]),
                embedding=Spread.of([sum(one[name] for name in EMBEDDING) for one in stages]),
                matching=Spread.of(matching),
            )
        )
    return rows
