"""The report of near-identical shapes, from the pairs that the database keeps."""

from collections.abc import Sequence, Set
from dataclasses import dataclass
from time import monotonic

import numpy as np
from starlette.concurrency import run_in_threadpool

from service.container import Container
from service.duplicates import repository
from service.duplicates.background import judge_for
from service.duplicates.groups import GroupMember, Groups
from service.duplicates.judgements import Search
from service.errors import StorageFullError, StorageUnavailableError
from service.observability.logging import get_logger
from service.observability.timings import Timings
from service.pipelines.active import ActivePipeline
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter, ShapeRecord
from service.storage.database import ReadSession

JUDGING_SECONDS = 20.0
"""The time after which a request begins to judge no further shape."""

AT_ONCE = 1_000
"""Shapes that one statement reads."""

log = get_logger("duplicates")


@dataclass(frozen=True)
class DuplicateCriteria:
    """The shapes of the report, the least CC of a pair, the largest residual, and whether variants count."""

    filter: ShapeFilter
    min_cc: float
    max_residual: float
    variants: bool


@dataclass(frozen=True)
class Duplicates:
    """Groups of near-identical shapes.

    Attributes
    ----------
    groups : list
        Each with its members and their records.
    shapes : int
        Number of shapes of the report.
    compared, aligned : int
        Numbers of pairs that were compared and registered to judge them.
    unjudged : int
        Number of shapes of the collection that are not judged yet.
    """

    groups: list[list[tuple[GroupMember, ShapeRecord]]]
    shapes: int
    compared: int
    aligned: int
    unjudged: int


async def find(
    container: Container, wanted: DuplicateCriteria, active_pipeline: ActivePipeline, timings: Timings
) -> Duplicates:
    """Find the groups of near-identical shapes.

    Shapes that are not judged yet are judged first, for about `JUDGING_SECONDS`, where the archive can be
    written to. The kept pairs within the limits join the shapes of the whole collection; the filter chooses
    among the members of the groups.
    """
    kinds = (False, True) if wanted.variants else (False,)
    searches = [Search(active_pipeline.fingerprint, variants) for variants in kinds]
    with timings.stage("judge"):
        end = monotonic() + JUDGING_SECONDS
        try:
            for search in searches:
                await judge_for(container, active_pipeline, search, wanted.filter.collection, end)
        except (StorageFullError, StorageUnavailableError) as error:
            log.warning("the shapes are judged later: %s", error)

    def read() -> Duplicates:
        with container.database.read() as session:
            return _report(session, searches, wanted)

    with timings.stage("results"):
        return await run_in_threadpool(read)


def _report(session: ReadSession, searches: Sequence[Search], wanted: DuplicateCriteria) -> Duplicates:
    fingerprint, collection = searches[0].fingerprint, wanted.filter.collection
    shapes = repository.embedded(session, fingerprint, wanted.filter)
    groups = Groups()
    for link in repository.links_of(
        session,
        fingerprint,
        collection,
        min_cc=wanted.min_cc,
        max_residual=wanted.max_residual,
        variants=wanted.variants,
    ):
        groups.join(link)
    shown = _shown(session, fingerprint, wanted.filter, groups.members(shapes))
    compared, aligned = np.sum([repository.counts(session, each, shapes) for each in searches], axis=0)
    unjudged = max(repository.count_unjudged(session, each, collection) for each in searches)
    return Duplicates(shown, len(shapes), int(compared), int(aligned), unjudged)


def _shown(
    session: ReadSession, fingerprint: str, wanted: ShapeFilter, groups: list[list[GroupMember]]
) -> list[list[tuple[GroupMember, ShapeRecord]]]:
    """The groups with the records of their shapes."""
    numbers: Set[int] = {member.shape for group in groups for member in group}
    ordered = sorted(numbers)
    known = {
        record.number: record
        for start in range(0, len(ordered), AT_ONCE)
        for record in shapes_repository.records(
            session, fingerprint, wanted.collection, ordered[start : start + AT_ONCE]
        )
    }
    return [[(member, known[member.shape]) for member in group] for group in groups]
