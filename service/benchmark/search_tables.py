"""What `service.benchmark.searching` measured, as tables."""

from collections.abc import Sequence

from service.benchmark.searching import Kept, Row

STAGES = ("read", "shortlist", "compare", "results")


def search_table(rows: Sequence[Row]) -> list[list[str]]:
    """A line an archive: milliseconds, MiB."""
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


def kept_table(rows: Sequence[Kept]) -> list[list[str]]:
    """A line a length of the cascade."""

    def count(of: int | None) -> str:
        return "all" if of is None else f"{of:,}"

    return [
        [
            "sifted",
            "screened",
            "in full, beside those wanted",
            "the same first",
            "first of the class",
            "first ten of it",
            "median, ms",
        ],
        *(
            [
                *(count(of) for of in (row.length, row.screened, row.finalists)),
                *(f"{100 * share:.1f} %" for share in (row.first, row.nn, row.ten)),
                f"{1e3 * row.median:,.0f}",
            ]
            for row in rows
        ),
    ]
