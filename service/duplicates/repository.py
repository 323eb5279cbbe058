"""The SQL of near-identical shapes."""

from collections.abc import Collection, Sequence
from dataclasses import asdict, astuple
from typing import Any

from sqlalchemy import ColumnElement, Select, delete, func, or_, select

from service.collection import CollectionNumber
from service.duplicates.groups import Link, Search
from service.index.repository import ENTRIES
from service.shapes.records import ShapeFilter
from service.shapes.repository import matching
from service.storage.database import ReadSession, WriteSession
from service.storage.tables import (
    DuplicatePairRow,
    EmbeddingRow,
    JudgedShapeRow,
    ShapeRow,
    SourceFileRow,
    SourceRow,
)

LINK = (
    DuplicatePairRow.first_number,
    DuplicatePairRow.second_number,
    DuplicatePairRow.cc,
    DuplicatePairRow.residual,
    DuplicatePairRow.scale,
    DuplicatePairRow.mirrored,
    DuplicatePairRow.variant,
    DuplicatePairRow.difference,
)
"""The columns of the fields of a link, in their order."""


MOST_PATHS = 100
"""Paths of a shape that are told."""


def embedded(session: ReadSession, fingerprint: str, wanted: ShapeFilter) -> frozenset[int]:
    """Return the numbers of the shapes that match a filter and have an embedding by a pipeline."""
    return frozenset(
        session.scalars(_embedded(fingerprint).where(ShapeRow.number.in_(matching(wanted)))).all()
    )


def unjudged(
    session: ReadSession, search: Search, *, collection: CollectionNumber | None = None, limit: int
) -> list[tuple[CollectionNumber, int]]:
    """Return at most `limit` shapes whose duplicates are unknown: collection and number, oldest first."""
    query = select(ShapeRow.collection_number, ShapeRow.number).where(
        ShapeRow.number.in_(_unjudged(search, collection))
    )
    rows = session.execute(query.order_by(ShapeRow.number).limit(limit))
    return [(CollectionNumber(of), number) for of, number in rows]


def count_unjudged(session: ReadSession, search: Search, collection: CollectionNumber) -> int:
    """Return the number of shapes of a collection that are not judged."""
    return session.scalar(select(func.count()).select_from(_unjudged(search, collection).subquery())) or 0


def judged(session: ReadSession, search: Search, shapes: Sequence[int]) -> set[int]:
    """Return those of some shapes that are judged."""
    query = select(JudgedShapeRow.shape_number).where(*_by(search), JudgedShapeRow.shape_number.in_(shapes))
    return set(session.scalars(query))


def judged_since(session: ReadSession, search: Search, since: int) -> set[int]:
    """Return the shapes that were judged after a judgement."""
    query = select(JudgedShapeRow.shape_number).where(*_by(search), JudgedShapeRow.number > since)
    return set(session.scalars(query))


def has_begun(session: ReadSession, search: Search) -> bool:
    """Return whether the search has judged any shape."""
    return session.scalar(select(JudgedShapeRow.number).where(*_by(search)).limit(1)) is not None


def latest(session: ReadSession) -> int:
    """Return the number of the latest judgement; 0 before the first."""
    return session.scalar(select(func.max(JudgedShapeRow.number))) or 0


def write(
    session: WriteSession, search: Search, shape: int, links: Sequence[Link], *, compared: int, aligned: int
) -> None:
    """Store the judgement of a shape and the pairs that it found, unless they are stored."""
    row = DuplicatePairRow
    of_shape = or_(row.first_number == shape, row.second_number == shape)
    stored = _links(session, select(*LINK).where(row.fingerprint == search.fingerprint, of_shape))
    known = {(link.first, link.second) for link in stored}
    for link in links:
        if (link.first, link.second) not in known:
            values = dict(zip((column.key for column in LINK), astuple(link), strict=True))
            session.add(DuplicatePairRow(fingerprint=search.fingerprint, **values))
    session.execute(
        delete(JudgedShapeRow).where(
            JudgedShapeRow.shape_number == shape,
            JudgedShapeRow.variants.is_(search.variants),
            JudgedShapeRow.fingerprint == search.fingerprint,
        )
    )
    session.add(JudgedShapeRow(shape_number=shape, compared=compared, aligned=aligned, **asdict(search)))


def links_among(session: ReadSession, fingerprint: str, shapes: Sequence[int]) -> list[Link]:
    """Return the pairs of copies among some shapes."""
    row = DuplicatePairRow
    inside = row.first_number.in_(shapes), row.second_number.in_(shapes)
    return _links(
        session, select(*LINK).where(row.fingerprint == fingerprint, row.variant.is_(False), *inside)
    )


def links_of(session: ReadSession, collection: CollectionNumber, bounds: Search) -> list[Link]:
    """Return the pairs of a collection within the bounds of a search."""
    row = DuplicatePairRow
    query = (
        select(*LINK)
        .join(ShapeRow, ShapeRow.number == row.first_number)
        .where(
            ShapeRow.collection_number == collection,
            row.fingerprint == bounds.fingerprint,
            row.residual <= bounds.max_residual,
        )
        .order_by(row.first_number, row.second_number)
    )
    return _links(session, query if bounds.variants else query.where(row.variant.is_(False)))


def _links(session: ReadSession, query: Select[*tuple[Any, ...]]) -> list[Link]:
    """Return the pairs that a query of the columns `LINK` finds."""
    return [Link(*columns) for columns in session.execute(query)]


def counts(session: ReadSession, search: Search, shapes: Collection[int]) -> tuple[int, int]:
    """Return the numbers of compared and of registered pairs by which some shapes were judged."""
    query = select(JudgedShapeRow.shape_number, JudgedShapeRow.compared, JudgedShapeRow.aligned)
    rows = [row for row in session.execute(query.where(*_by(search))) if row.shape_number in shapes]
    return sum(row.compared for row in rows), sum(row.aligned for row in rows)


def _embedded(fingerprint: str) -> Select[int]:
    """Return the shapes that the index of signatures has."""
    return ENTRIES.with_only_columns(ShapeRow.number).where(EmbeddingRow.fingerprint == fingerprint)


def _unjudged(search: Search, collection: CollectionNumber | None) -> Select[int]:
    done = select(JudgedShapeRow.number).where(JudgedShapeRow.shape_number == ShapeRow.number, *_by(search))
    query = _embedded(search.fingerprint).where(~done.exists())
    return query if collection is None else query.where(ShapeRow.collection_number == collection)


def _by(search: Search) -> tuple[ColumnElement[bool], ...]:
    """Return the conditions of judgements by a search, or by one with looser bounds."""
    row = JudgedShapeRow
    return (
        row.fingerprint == search.fingerprint,
        row.variants.is_(search.variants),
        row.max_residual >= search.max_residual,
    )


def paths_of(
    session: ReadSession, collection: CollectionNumber, shapes: Collection[int]
) -> dict[int, list[str]]:
    """Return the paths of the first `MOST_PATHS` files of shapes that are in a collection's sources now."""
    place = func.row_number().over(
        partition_by=SourceFileRow.shape_number, order_by=(SourceFileRow.source_number, SourceFileRow.key)
    )
    files = (
        select(SourceFileRow.shape_number, SourceRow.root, SourceFileRow.path, place.label("place"))
        .join(SourceRow, SourceRow.number == SourceFileRow.source_number)
        .where(SourceFileRow.shape_number.in_(shapes), SourceFileRow.state == "present")
        .where(SourceRow.collection_number == collection, SourceRow.removed_at.is_(None))
        .subquery()
    )
    first = select(files.c.shape_number, files.c.root, files.c.path).where(files.c.place <= MOST_PATHS)
    paths: dict[int, list[str]] = {}
    for shape, root, path in session.execute(first.order_by(files.c.shape_number, files.c.place)):
        paths.setdefault(shape, []).append(f"{root}/{path}")
    return paths
