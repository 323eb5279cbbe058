"""Unit mistakes: shapes that would pass a filter by size if the files had another unit."""

from dataclasses import replace

from starlette.concurrency import run_in_threadpool

from service.container import Container
from service.observability.timings import Timings
from service.search import service
from service.search.records import Answer, Options, Query, UnitMistake
from service.shapes import repository as shapes_repository

UNITS = (10.0, 25.4, 1000.0)
"""Millimetres in a centimetre, in an inch and in a metre."""

FACTORS = (*UNITS, *(1.0 / factor for factor in UNITS))


async def with_unit_mistake(
    container: Container, query: Query, options: Options, answer: Answer, timings: Timings
) -> Answer:
    """The answer; if no shape passed the filter by size, with the shapes that are `FACTORS` times as large.

    The database counts them. Only if there are some, the query is compared with them.
    """
    wanted = options.sized(query.embedding.facts.area)
    if answer.compared or not wanted.has_sizes:
        return answer
    with timings.stage("units"):
        return replace(answer, unit_mistake=await _unit_mistake(container, query, options))


async def _unit_mistake(container: Container, query: Query, options: Options) -> UnitMistake | None:
    wanted = options.sized(query.embedding.facts.area)

    def counted() -> dict[float, int]:
        with container.database.read() as session:
            return {factor: shapes_repository.count(session, wanted.scaled(factor)) for factor in FACTORS}

    mistakes = []
    for factor, count in (await run_in_threadpool(counted)).items():
        if count:
            one = replace(
                options,
                top_k=1,
                rank_by="cc",
                filter=wanted.scaled(factor),
                sizes=None,
                min_cc=-1.0,
                correspondences=False,
            )
            found = (await service.search(container, query, one, Timings())).found
            mistakes += [UnitMistake(factor, count, nearest) for nearest in found]
    return max(mistakes, key=lambda mistake: mistake.nearest.cc, default=None)
