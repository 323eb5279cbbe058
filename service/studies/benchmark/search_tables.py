"""The measurements of `service.studies.benchmark.searching` as tables."""

from collections.abc import Sequence

from service.studies.benchmark.ingesting import IngestRow
from service.studies.benchmark.load import LoadRow
from service.studies.benchmark.searching import CascadeRow, SearchRow

STAGES = ("read", "shortlist", "compare", "results")


def search_table(rows: Sequence[SearchRow]) -> list[list[str]]:
    """A line for each archive: milliseconds, MiB."""
    return [
        [
            "shapes",
            "compared in full",
            "queries",
            "start, s",
            "first, ms",
            "median, ms",
            "p95, ms",
            *(f"{stage}, ms" for stage in STAGES),
            "memory, MiB",
        ],
        *(
            [
                f"{row.shapes:,}",
                f"{row.compared:,}",
                f"{row.queries}",
                f"{row.start:.1f}",
                *(f"{1e3 * seconds:,.0f}" for seconds in (row.first, row.median, row.p95)),
                *(f"{1e3 * row.stages[stage]:,.1f}" for stage in STAGES),
                f"{row.memory / 2**20:,.0f}",
            ]
            for row in rows
        ),
    ]


def cascade_table(rows: Sequence[CascadeRow]) -> list[list[str]]:
    """A line for each choice of stage lengths."""

    def count(of: int | None) -> str:
        return "all" if of is None else f"{of:,}"

    return [
        [
            "ranked by",
            "shortlist",
            "after coarse ranking",
            "in full, besides the results",
            "same first result",
            "first result of the class",
            "first ten of the class",
            "median, ms",
        ],
        *(
            [
                row.rank_by,
                *(count(of) for of in (row.length, row.reranked, row.finalists)),
                *(f"{100 * share:.1f} %" for share in (row.first, row.nn, row.ten)),
                f"{1e3 * row.median:,.0f}",
            ]
            for row in rows
        ),
    ]


def ingest_table(rows: Sequence[IngestRow]) -> list[list[str]]:
    """A line a number of processors; the last is that of one."""
    table = [["processors", "shapes", "shapes a second", "times one processor"]]
    one = rows[-1].a_second.median
    for row in rows:
        rate = row.a_second
        table.append(
            [
                str(row.processors),
                f"{row.shapes:,}",
                f"{rate.median:.1f} ({rate.low:.1f} to {rate.high:.1f})",
                f"{rate.median / one:.2f}",
            ]
        )
    return table


def load_table(rows: Sequence[LoadRow]) -> list[list[str]]:
    """A line a measurement: milliseconds."""
    return [
        [
            "shapes",
            "clients querying, ingesting",
            "capacity, queries and uploads a second",
            "one client alone: median, p95, ms",
            "under half of the capacity: median, p95, ms",
            "p95 over that of one alone",
            "queries, uploads",
            "errors",
        ],
        *(
            [
                f"{row.shapes:,}",
                f"{row.querying}, {row.ingesting}",
                f"{row.queries_a_second:.1f}, {row.uploads_a_second:.1f}",
                f"{1e3 * row.alone_median:,.0f}, {1e3 * row.alone_p95:,.0f}",
                f"{1e3 * row.median:,.0f}, {1e3 * row.p95:,.0f}",
                f"{row.p95 / row.alone_p95:.1f}",
                f"{row.queries:,}, {row.uploads:,}",
                f"{row.errors}",
            ]
            for row in rows
        ),
    ]
