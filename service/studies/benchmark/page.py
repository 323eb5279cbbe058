"""The measurements as Markdown, and as one object."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field

from service.studies.benchmark import growth, searching
from service.studies.benchmark.embedding import PEER_VALUES, EmbeddingTimes
from service.studies.benchmark.functional_maps import SPECTRUM
from service.studies.benchmark.growth import FORMATS, GrowthRow
from service.studies.benchmark.ingesting import IngestRow
from service.studies.benchmark.load import SHARE, LoadRow
from service.studies.benchmark.match_tables import match_table, peer_table
from service.studies.benchmark.matching import MANY, MatchRow
from service.studies.benchmark.pictures import PictureRow, picture_table
from service.studies.benchmark.search_tables import cascade_table, ingest_table, load_table, search_table
from service.studies.benchmark.searching import EXHAUSTIVE, SHORTLIST_FROM, CascadeRow, SearchRow
from service.studies.benchmark.table1 import Table1Row

PLOT, SEARCH_PLOT = "benchmark-growth.png", "benchmark-search.png"

Table = list[list[str]]


@dataclass(frozen=True)
class BenchmarkResults:
    """The rows of every measured subject; the lists of other subjects are empty."""

    embedding: list[EmbeddingTimes] = field(default_factory=list)
    growth: list[GrowthRow] = field(default_factory=list)
    table1: list[Table1Row] = field(default_factory=list)
    match: list[MatchRow] = field(default_factory=list)
    search: list[SearchRow] = field(default_factory=list)
    kept: list[CascadeRow] = field(default_factory=list)
    ingest: list[IngestRow] = field(default_factory=list)
    load: list[LoadRow] = field(default_factory=list)
    pictures: list[PictureRow] = field(default_factory=list)

    def as_json(self) -> dict[str, object]:
        """The object that `--json` prints: lists of rows by subject; seconds and bytes."""
        found: dict[str, object] = {}
        if self.embedding:
            found["embedding"] = [asdict(row) for row in self.embedding]
        if self.growth:
            found["growth"] = {
                "rows": [asdict(row) for row in self.growth],
                "exponents": growth.exponents(self.growth),
            }
        if self.table1:
            found["table1"] = [{**asdict(row), "faster": row.faster()} for row in self.table1]
        if self.match:
            found["match"] = [asdict(row) for row in self.match]
        if self.search:
            found["search"] = {
                "rows": [asdict(row) for row in self.search],
                "kept": [asdict(row) for row in self.kept],
            }
        if self.ingest:
            found["ingest"] = [asdict(row) for row in self.ingest]
        if self.load:
            found["load"] = [asdict(row) for row in self.load]
        if self.pictures:
            found["pictures"] = [asdict(row) for row in self.pictures]
        return found


def page(found: BenchmarkResults, command: str, *, picture: bool) -> str:
    """All tables under headings, with the command that made them."""
    parts = [
        "# Benchmark",
        f"Measured by `{command}`. One thread; every figure is a median, with its quartiles in brackets. "
        "Ratios are between neighbouring measurements in the same run.",
    ]
    if found.embedding:
        parts += ["## Embedding a file of about 3,000 vertices", _markdown(embedding_table(found.embedding))]
        if all(row.peer is not None for row in found.embedding):
            parts.append(
                "Our time is from the bytes of a binary PLY to the embedding; LaPy's is ShapeDNA with "
                f"{PEER_VALUES} eigenvalues from a mesh already read."
            )
        parts.append(_markdown(stage_table(found.embedding)))
    if found.growth:
        powers = growth.exponents(found.growth)
        parts += [
            "## Cost against size",
            _markdown(growth_table(found.growth)),
            "One mesh, its edges halved until it has that size. Each line is a fresh process, whose peak "
            "memory includes its libraries. Time grows as the number of vertices to the power "
            f"{powers[0]:.2f}, memory to the power {powers[1]:.2f}.",
            _markdown(growth_stage_table(found.growth)),
        ]
        if picture:
            parts.append(f"![Seconds and memory against vertices]({PLOT})")
    if found.table1:
        parts += [
            "## The paper's Table 1",
            _markdown(times_table(found.table1)),
            "In seconds: the paper's / ours (times faster). Our meshes are of the nearest class, brought to "
            "the paper's number of points; sampling includes cleaning and simplification.",
        ]
    if found.match:
        parts += [
            "## One match of two stored shapes",
            _markdown(match_table(found.match)),
            f"Both ways, in every embedding, to CC, SSD and sim. One of {MANY}: a shape with that many match "
            "records in one call, as in a query. Re-ranking and coarse ranking: the two stages of a search "
            "before the full match. Score: one match by `Pipeline.score`. From records: from the bytes of "
            "two stored embeddings without any cache, and its parts.",
        ]
        if all(row.peer is not None for row in found.match):
            parts += [
                _markdown(peer_table(found.match)),
                "Pyfmaps with its defaults: wave kernel signatures, a map fitted and refined by ZoomOut, one "
                f"way; its spectra, of {SPECTRUM} eigenvalues, are timed separately. The ratios say how many "
                "times longer its match takes than ours, of many in one call and from records. The ratio "
                "from meshes includes its spectra on one side, and our embeddings and match records on the "
                "other.",
            ]
    if found.search:
        parts += [
            "## Queries over HTTP",
            _markdown(search_table(found.search)),
            "Queries by the id of a stored shape, after the service has filled its cache of match records. "
            "The service has default settings, but does not search for duplicates. Archives of "
            f"{SHORTLIST_FROM:,} to {EXHAUSTIVE:,} shapes are searched exhaustively too. Shapes beyond the "
            "size of the collection are copies of its embeddings with noise. Memory is the service's own "
            "process.",
        ]
        shown = searching.by_default(found.search)
        if len(shown) > 1:
            powers = searching.exponents(shown)
            parts.append(
                f"Time grows as the number of shapes to the power {powers[0]:.2f}, memory to the power "
                f"{powers[1]:.2f}."
            )
            if picture:
                parts.append(f"![Seconds and memory against shapes]({SEARCH_PLOT})")
        if found.kept:
            parts += [
                _markdown(cascade_table(found.kept)),
                f"The stages of a search against exhaustive search of {found.kept[0].shapes:,} shapes, "
                f"{found.kept[0].queries} queries, with their own noisy copies left out of the "
                "answers.",
            ]
    if found.ingest:
        parts += [
            "## A folder stored",
            _markdown(ingest_table(found.ingest)),
            "The collection's files sent over HTTP as `isoshape ingest` sends them, to an empty archive on "
            "SQLite. The service, one worker for each processor, and the sender share the processors.",
        ]
    if found.load:
        parts += [
            "## Many clients at once",
            _markdown(load_table(found.load)),
            "Capacity: the rate of answers while every client asks again as soon as it has an answer. Then "
            f"{SHARE:.0%} of that rate is asked for evenly, and a query's time counts from when it was due.",
        ]
    if found.pictures:
        parts += [
            "## Thumbnails over HTTP",
            _markdown(picture_table(found.pictures)),
            "256 pixels a side, as on the page. Drawn: the first request, in a warm worker, which reads the "
            "file first. CascadeRow: every later request, from the database.",
        ]
    return "\n\n".join(parts) + "\n"


def embedding_table(rows: Sequence[EmbeddingTimes]) -> Table:
    """A line for each mesh."""
    table = [["mesh", "vertices", "embedding, ms", "LaPy, ms", "ratio"]]
    for row in rows:
        peer = row.peer.milliseconds() if row.peer else ""
        ratio = f"{row.ratio.median:.2f} ({row.ratio.low:.2f} to {row.ratio.high:.2f})" if row.ratio else ""
        table.append([row.name, f"{row.vertices:,}", row.seconds.milliseconds(), peer, ratio])
    return table


def stage_table(rows: Sequence[EmbeddingTimes]) -> Table:
    """A line a stage, a column a mesh: milliseconds."""
    return [
        ["stage, ms", *(row.name for row in rows)],
        *([stage, *(row.stages[stage].milliseconds() for row in rows)] for stage in rows[0].stages),
    ]


def growth_table(rows: Sequence[GrowthRow]) -> Table:
    """A line a size and format."""
    table = [["vertices", "faces", "file", "seconds", "peak memory, MiB"]]
    for row in rows:
        spread = row.seconds
        table.append(
            [
                f"{row.vertices:,}",
                f"{row.faces:,}",
                f"{row.format.upper()}, {row.file_bytes / 2**20:.1f} MiB",
                f"{spread.median:.2f} ({spread.low:.2f} to {spread.high:.2f})",
                f"{row.peak_bytes / 2**20:,.0f}",
            ]
        )
    return table


def growth_stage_table(rows: Sequence[GrowthRow]) -> Table:
    """A line a stage, a column a size: milliseconds."""
    shown = [row for row in rows if row.format == FORMATS[0]]
    return [
        ["stage, ms", *(f"{row.vertices:,}" for row in shown)],
        *([stage, *(f"{1e3 * row.stages[stage]:,.1f}" for row in shown)] for stage in shown[0].stages),
    ]


def times_table(rows: Sequence[Table1Row]) -> Table:
    """A line for each category of the paper."""
    table = [
        ["models (points)", "ours: vertices", "samples (points)", "sampling", "MST, embedding", "matching"]
    ]
    for row in rows:
        paper = row.paper
        stages = zip(
            (paper.sampling, paper.embedding, paper.matching),
            (row.sampling, row.embedding, row.matching),
            row.faster(),
            strict=True,
        )
        table.append(
            [
                f"{paper.title} ({paper.points:,})",
                f"{row.vertices:,}",
                f"{row.samples} ({row.points})",
                *(f"{theirs:g} / {ours.median:.4f} ({times:,.0f})" for theirs, ours, times in stages),
            ]
        )
    return table


def _markdown(table: Table) -> str:
    head, *rows = table
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
