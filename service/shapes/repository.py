"""The SQL of shapes, and of the answers to uploads with an Idempotency-Key."""

import uuid
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import (
    ColumnElement,
    Select,
    and_,
    case,
    delete,
    func,
    literal,
    or_,
    select,
    true,
    tuple_,
    update,
)

from service.collection import CollectionNumber
from service.errors import IdempotencyKeyReusedError
from service.http.idempotency import Claim, Kept
from service.index import neighbour_repository
from service.shapes.fields import plain_values
from service.shapes.file_repository import is_its_embedding
from service.shapes.records import NewFile, NewShape, Position, ShapeFilter, ShapeRecord, Sort, StoredFile
from service.shapes.rule_repository import with_rules
from service.shapes.word_repository import having, index_words, relevances
from service.storage.checksums import SHAPE_COLUMNS, SHAPE_TIMES, shape_checksum
from service.storage.columns import UtcDateTime
from service.storage.database import ReadSession, WriteSession, drop_unused, erase, next_revision
from service.storage.tables import (
    NOT_DELETED,
    ArchiveRow,
    BlobRow,
    CollectionRow,
    DuplicateMergeRow,
    DuplicatePairRow,
    EmbeddingRow,
    IdempotencyKeyRow,
    JudgedShapeRow,
    MetadataRow,
    RemovalRow,
    ShapeRow,
    SourceFileRow,
    TagRow,
)

LENGTH = ShapeRow.facts[("bounding_box", 0)].as_float()
"""The largest side of the bounding box."""


def matching(shapes: ShapeFilter) -> Select[int]:
    """Return a query of the numbers of the shapes that match a filter."""
    in_collection = ShapeRow.collection_number == shapes.collection
    return select(ShapeRow.number).where(in_collection, NOT_DELETED, conditions(shapes))


def conditions(shapes: ShapeFilter) -> ColumnElement[bool]:
    """Return the condition that a shape of any collection, deleted or not, matches the rest of a filter."""
    required: list[ColumnElement[bool]] = [true()]
    for tag in shapes.tags:
        required.append(ShapeRow.number.in_(select(TagRow.shape_number).where(TagRow.tag == tag)))
    for key, value in shapes.metadata:
        same = select(MetadataRow.shape_number).where(MetadataRow.key == key, MetadataRow.value == value)
        required.append(ShapeRow.number.in_(same))
    if shapes.words:
        required.append(having(shapes.words, by_paths=shapes.by_paths))
    if shapes.name:
        required.append(ShapeRow.folded_name.contains(shapes.name.casefold(), autoescape=True))
    if shapes.file_format is not None:
        required.append(ShapeRow.format == shapes.file_format)
    if shapes.sha256 is not None:
        same_bytes = select(BlobRow.number).where(BlobRow.sha256 == shapes.sha256)
        required.append(ShapeRow.blob_number.in_(same_bytes))
    if shapes.excluded:
        required.append(ShapeRow.id.not_in(shapes.excluded))
    if shapes.area is not None:
        required.append(ShapeRow.facts["area"].as_float().between(*shapes.area))
    if shapes.volume is not None:
        required.append(ShapeRow.facts["boundary_edges"].as_integer() == 0)
        required.append(ShapeRow.facts["volume"].as_float().between(*shapes.volume))
    if shapes.length is not None:
        required.append(LENGTH.between(*shapes.length))
    return and_(*required)


def numbers(session: ReadSession, shapes: ShapeFilter) -> Sequence[int]:
    """Return the numbers of the shapes that match a filter."""
    return session.scalars(matching(shapes)).all()


def numbers_of(session: ReadSession, ids: Sequence[str]) -> Sequence[int]:
    """Return the numbers of the shapes with some ids."""
    return session.scalars(select(ShapeRow.number).where(ShapeRow.id.in_(ids))).all() if ids else []


def count(session: ReadSession, shapes: ShapeFilter) -> int:
    """Return the number of shapes that match a filter."""
    return session.scalar(select(func.count()).select_from(matching(shapes).subquery())) or 0


def stored(session: ReadSession, collection: CollectionNumber) -> int:
    """Return the number of shapes of a collection.

    If no other collection has shapes, the deleted rows are taken from all rows: SQLite counts all rows of a
    table in a third of the time of those that match a condition.
    """
    if others_hold_shapes(session, collection):
        query = select(func.count()).where(ShapeRow.collection_number == collection, NOT_DELETED)
        return session.scalars(query).one()
    deleted = select(func.count()).where(~NOT_DELETED).scalar_subquery()
    return session.scalars(select(func.count() - deleted).select_from(ShapeRow)).one()


def others_hold_shapes(session: ReadSession, collection: CollectionNumber) -> bool:
    """Return whether another collection has a shape."""
    shape = select(ShapeRow.number).where(ShapeRow.collection_number == CollectionRow.number, NOT_DELETED)
    query = select(CollectionRow.number).where(CollectionRow.number != collection, shape.exists())
    return session.scalar(query.limit(1)) is not None


def page(
    session: ReadSession, shapes: ShapeFilter, *, after: Position | None, limit: int, sort: Sort
) -> tuple[list[tuple[Position, ShapeRecord]], int]:
    """Return the next `limit` shapes that match a filter, each after its position, and the number of all.

    The order by relevance needs a filter by words.
    """
    if sort == "relevance":
        rows, total = _most_relevant(session, shapes, after, limit)
    else:
        number, name = ShapeRow.number, ShapeRow.folded_name
        order = (name, number) if sort == "name" else (number.desc() if sort == "newest" else number,)
        query = matching(shapes).with_only_columns(number, name).limit(limit).order_by(*order)
        if after is not None and sort == "name":
            query = query.where(tuple_(name, number) > tuple_(after.name or "", after.number))
        elif after is not None:
            query = query.where(number < after.number if sort == "newest" else number > after.number)
        rows = [Position(number, name if sort == "name" else None) for number, name in session.execute(query)]
        total = count(session, shapes)
    positions = {position.number: position for position in rows}
    found = records(session, shapes.collection, list(positions))
    return [(positions[record.number], record) for record in found], total


def _most_relevant(
    session: ReadSession, shapes: ShapeFilter, after: Position | None, limit: int
) -> tuple[list[Position], int]:
    """Return the positions of the next shapes that have all words of a filter, the most relevant first.

    One statement counts them all too: to find them takes most of its time.
    """
    found = relevances(shapes.words or "", by_paths=shapes.by_paths)
    every = (
        matching(replace(shapes, words=None))
        .with_only_columns(ShapeRow.number, found.c.points, func.count().over().label("total"))
        .join(found, found.c.shape_number == ShapeRow.number)
        .subquery()
    )
    number, points = every.c.number, every.c.points
    query = select(number, points, every.c.total).order_by(points.desc(), number).limit(limit)
    if after is not None:
        less = points < after.points
        query = query.where(or_(less, and_(points == after.points, number > after.number)))
    rows = session.execute(query).all()
    total = rows[0].total if rows else count(session, shapes)
    return [Position(row.number, points=int(row.points)) for row in rows], total


def by_id(
    session: ReadSession, collection: CollectionNumber, shape_id: str, deleted_since: datetime | None = None
) -> ShapeRecord | None:
    """Return the shape of a collection with an id; with `deleted_since`, one that was deleted since then."""
    numbers = session.scalars(select(ShapeRow.number).where(ShapeRow.id == shape_id)).all()
    condition = NOT_DELETED if deleted_since is None else ShapeRow.deleted_at > deleted_since
    return next(iter(records(session, collection, numbers, condition)), None)


def records(
    session: ReadSession,
    collection: CollectionNumber,
    numbers: Sequence[int],
    condition: ColumnElement[bool] = NOT_DELETED,
) -> list[ShapeRecord]:
    """Return the shapes of a collection with some numbers that satisfy a condition, in the numbers' order."""
    shown = (
        select(ShapeRow, BlobRow.sha256, BlobRow.size, EmbeddingRow.number)
        .join(BlobRow, BlobRow.number == ShapeRow.blob_number)
        .outerjoin(EmbeddingRow, is_its_embedding(select(ArchiveRow.fingerprint).scalar_subquery()))
        .where(ShapeRow.number.in_(numbers), ShapeRow.collection_number == collection, condition)
    )
    tags: dict[int, list[str]] = {}
    tag_rows = select(TagRow).where(TagRow.shape_number.in_(numbers)).order_by(TagRow.position)
    for tag in session.scalars(tag_rows):
        tags.setdefault(tag.shape_number, []).append(tag.tag)
    by_number = {
        row.number: ShapeRecord(
            number=row.number,
            id=row.id,
            name=row.name,
            tags=tuple(tags.get(row.number, ())),
            metadata=row.meta,
            format=row.format,
            bytes=size,
            sha256=sha256,
            facts=row.facts,
            embedded=embedding is not None,
            created_at=row.created_at,
            updated_at=row.updated_at,
            deleted_at=row.deleted_at,
        )
        for row, sha256, size, embedding in session.execute(shown)
    }
    return [by_number[number] for number in numbers if number in by_number]


def deleted_page(
    session: ReadSession, collection: CollectionNumber, since: datetime, *, after: int, limit: int
) -> list[tuple[int, ShapeRecord]]:
    """Return the next `limit` shapes deleted since a time, each after the number of its deletion."""
    query = (
        select(RemovalRow.revision, ShapeRow.number)
        .join(ShapeRow, ShapeRow.number == RemovalRow.shape_number)
        .where(ShapeRow.collection_number == collection, ShapeRow.deleted_at > since)
        .where(RemovalRow.revision > after)
        .order_by(RemovalRow.revision)
        .limit(limit)
    )
    rows = session.execute(query).all()
    deletions = {number: revision for revision, number in rows}
    shapes = records(session, collection, list(deletions), ~NOT_DELETED)
    return [(deletions[shape.number], shape) for shape in shapes]


def count_deleted(session: ReadSession, collection: CollectionNumber, since: datetime) -> int:
    """Return the number of shapes that were deleted from a collection since a time."""
    query = select(func.count()).where(ShapeRow.collection_number == collection, ShapeRow.deleted_at > since)
    return session.scalar(query) or 0


def any_deleted_until(session: ReadSession, moment: datetime) -> bool:
    """Return whether a shape was deleted, or merged, at a time or before."""
    old = ShapeRow.deleted_at <= moment, DuplicateMergeRow.merged_at <= moment
    return bool(session.scalar(select(or_(*(select(literal(1)).where(each).exists() for each in old)))))


def erase_deleted_until(session: WriteSession, moment: datetime) -> None:
    """Erase the shapes that were deleted at a time or before, and what undoes merges of that time."""
    erase(session, ShapeRow.deleted_at <= moment)
    session.execute(delete(DuplicateMergeRow).where(DuplicateMergeRow.merged_at <= moment))


def same(
    session: ReadSession, collection: CollectionNumber, file: NewFile | ShapeRecord, name: str
) -> ShapeRecord | None:
    """Return the shape of a collection with the bytes and the format of a file, and a name."""
    numbers = session.scalars(
        select(ShapeRow.number)
        .join(BlobRow, BlobRow.number == ShapeRow.blob_number)
        .where(
            BlobRow.sha256 == file.sha256,
            ShapeRow.format == file.format,
            ShapeRow.name == name,
            ShapeRow.collection_number == collection,
            NOT_DELETED,
        )
    ).all()
    return next(iter(records(session, collection, numbers)), None)


def mark_changed(session: WriteSession, blob_number: int, format: str, facts: Mapping[str, Any]) -> None:
    """Have every process read the shapes on a newly embedded blob again."""
    conditions = ShapeRow.blob_number == blob_number, ShapeRow.format == format
    session.execute(update(ShapeRow).where(*conditions).values(revision=next_revision(session), facts=facts))
    _store_checksums(session, session.scalars(select(ShapeRow.number).where(*conditions)).all())


def add_shape(
    session: WriteSession, blob_number: int, new: NewShape, facts: Mapping[str, Any]
) -> ShapeRecord:
    """Store a shape on an embedded blob."""
    now = datetime.now(UTC)
    number = session.insert(
        ShapeRow,
        {
            "id": str(uuid.uuid4()),
            "collection_number": new.collection,
            "blob_number": blob_number,
            "format": new.format,
            "name": new.name,
            "folded_name": new.name.casefold(),
            "meta": dict(new.metadata),
            "facts": dict(facts),
            "created_at": now,
            "updated_at": now,
            "revision": next_revision(session),
            # It covers the tags and the metadata, whose rows refer to this one.
            "checksum": "",
        },
    )
    _write_tags(session, number, with_rules(session, new.collection, new.tags, new.metadata))
    _write_plain_values(session, number, new.metadata)
    index_words(session, [number])
    _store_checksums(session, [number])
    return records(session, new.collection, [number])[0]


def change(session: WriteSession, number: int, changes: Mapping[str, Any]) -> None:
    """Write changed fields of a shape, given by their names: `name`, `tags` or `metadata`."""
    values = _updated_now()
    if "name" in changes:
        values |= {"name": changes["name"], "folded_name": changes["name"].casefold()}
    if "metadata" in changes:
        values["meta"] = changes["metadata"]
        session.execute(delete(MetadataRow).where(MetadataRow.shape_number == number))
        _write_plain_values(session, number, changes["metadata"])
        changes = {**changes, "tags": _tags_by_rules(session, number, changes)}
    if "tags" in changes:
        session.execute(delete(TagRow).where(TagRow.shape_number == number))
        _write_tags(session, number, changes["tags"])
    _update(session, number, values)
    index_words(session, [number])


def set_tags(session: WriteSession, tags: Mapping[int, Sequence[str]]) -> None:
    """Write the tags of some shapes, given by their numbers."""
    session.execute(delete(TagRow).where(TagRow.shape_number.in_(tags)))
    for number, own in tags.items():
        _write_tags(session, number, own)
    session.execute(update(ShapeRow).where(ShapeRow.number.in_(tags)).values(_updated_now()))
    _store_checksums(session, list(tags))
    index_words(session, tags)


def _tags_by_rules(session: WriteSession, number: int, changes: Mapping[str, Any]) -> list[str]:
    """Return the tags of a shape whose metadata change, with those of the rules that the metadata meet."""
    collection = session.scalars(select(ShapeRow.collection_number).where(ShapeRow.number == number)).one()
    stored = select(TagRow.tag).where(TagRow.shape_number == number).order_by(TagRow.position)
    tags = changes["tags"] if "tags" in changes else session.scalars(stored).all()
    return with_rules(session, CollectionNumber(collection), tags, changes["metadata"])


def replace_file(session: WriteSession, record: ShapeRecord, format: str, file: StoredFile) -> None:
    """Give a shape another file, and delete the previous one unless another shape has it."""
    _forget(session, record.number)
    replaced = session.scalars(select(BlobRow.number).where(BlobRow.sha256 == record.sha256)).all()
    values = {"blob_number": file.blob_number, "format": format, "facts": dict(file.facts)}
    _update(session, record.number, {**_updated_now(), **values, "revision": next_revision(session)})
    drop_unused(session, replaced)


def move_shape(session: WriteSession, record: ShapeRecord, collection: CollectionNumber, name: str) -> None:
    """Move a shape to another collection, where it has a name and another number.

    What is kept by its old number goes, in the database and in the memory of every process. Its files in
    place stay its own.
    """
    columns = select(ShapeRow.__table__).where(ShapeRow.number == record.number)
    row = dict(session.execute(columns).mappings().one())
    del row["number"]
    # Both rows are there for a moment, so that the file stays, and ids are unique.
    row |= {"id": str(uuid.uuid4()), "collection_number": collection, "revision": next_revision(session)}
    row |= {"name": name, "folded_name": name.casefold()}
    number = session.insert(ShapeRow, row)
    _write_tags(session, number, with_rules(session, collection, record.tags, record.metadata))
    _write_plain_values(session, number, record.metadata)
    of_shape = SourceFileRow.shape_number == record.number
    session.execute(update(SourceFileRow).where(of_shape).values(shape_number=number))
    index_words(session, [number])
    erase_shape(session, record)
    _update(session, number, {**_updated_now(), "id": record.id})


def delete_shape(session: WriteSession, record: ShapeRecord) -> None:
    """Delete a shape, which keeps its number, file and embeddings until it is restored or erased."""
    _leave(session, record)
    _update(session, record.number, {"deleted_at": datetime.now(UTC)})


def restore_shape(session: WriteSession, record: ShapeRecord) -> None:
    """Undo the deletion of a shape, which gets the tags of rules as if it came."""
    session.execute(delete(RemovalRow).where(RemovalRow.shape_number == record.number))
    _update(session, record.number, {"deleted_at": None, "revision": next_revision(session)})
    change(session, record.number, {"metadata": record.metadata})


def erase_shape(session: WriteSession, record: ShapeRecord) -> None:
    """Erase a shape, deleted or not, and its file and embeddings unless another shape has them."""
    if record.deleted_at is None:
        _leave(session, record)
    erase(session, ShapeRow.number == record.number)


def _leave(session: WriteSession, record: ShapeRecord) -> None:
    """Take a shape out of pairs and neighbours, and out of the signatures in memory of every process."""
    _forget(session, record.number)
    session.add(RemovalRow(shape_number=record.number, revision=next_revision(session)))


def _update(session: WriteSession, number: int, values: Mapping[str, Any]) -> None:
    """Write columns of a shape, and its checksum."""
    session.execute(update(ShapeRow).where(ShapeRow.number == number).values(values))
    _store_checksums(session, [number])


def _store_checksums(session: WriteSession, numbers: Sequence[int]) -> None:
    """Store the checksums of shapes whose rows, tags or metadata this transaction has written."""
    session.flush()
    columns = [ShapeRow.__table__.c[name] for name in (*SHAPE_COLUMNS, *SHAPE_TIMES)]
    for number in numbers:
        row = session.execute(select(*columns).where(ShapeRow.number == number)).one()
        tags = select(TagRow.tag).where(TagRow.shape_number == number).order_by(TagRow.position)
        values = select(MetadataRow.key, MetadataRow.value).where(MetadataRow.shape_number == number)
        checksum = shape_checksum(
            dict(zip((*SHAPE_COLUMNS, *SHAPE_TIMES), row, strict=True)),
            session.scalars(tags).all(),
            [(entry.key, entry.value) for entry in session.execute(values)],
        )
        session.execute(update(ShapeRow).where(ShapeRow.number == number).values(checksum=checksum))


def _updated_now() -> dict[str, Any]:
    """Return the current time, but never before the previous change: the clock may have been set back."""
    now = literal(datetime.now(UTC), UtcDateTime())
    return {"updated_at": case((ShapeRow.updated_at > now, ShapeRow.updated_at), else_=now)}


def _write_tags(session: WriteSession, number: int, tags: Iterable[str]) -> None:
    session.add_all(
        TagRow(shape_number=number, tag=tag, position=position) for position, tag in enumerate(tags)
    )


def _write_plain_values(session: WriteSession, number: int, metadata: Mapping[str, Any]) -> None:
    session.add_all(
        MetadataRow(shape_number=number, key=key, value=value)
        for key, value in plain_values(dict(metadata)).items()
    )


def _forget(session: WriteSession, number: int) -> None:
    """Delete the pairs, the judgement and the neighbours of a shape; its copies are judged again.

    Two copies of a third shape need not be a pair themselves: without the third, their pair is unknown.
    """
    neighbour_repository.forget(session, number)
    first, second = DuplicatePairRow.first_number, DuplicatePairRow.second_number
    copies = select(first).where(second == number).union(select(second).where(first == number))
    unknown = JudgedShapeRow.shape_number
    session.execute(delete(JudgedShapeRow).where(or_(unknown == number, unknown.in_(copies))))
    session.execute(delete(DuplicatePairRow).where(or_(first == number, second == number)))


def kept_answer(session: ReadSession, claim: Claim, now: datetime) -> Kept | None:
    """Return the answer to the first request with the key; None if there is none, or it has expired.

    Raise IdempotencyKeyReusedError if that request had another payload.
    """
    row = session.get(IdempotencyKeyRow, (claim.collection, claim.scope, claim.key))
    if row is None or row.expires_at <= now:
        return None
    if row.payload != claim.payload:
        raise IdempotencyKeyReusedError(
            "the Idempotency-Key has come with another file or other fields before"
        )
    return Kept(row.status, row.location, row.body)


def keep_answer(session: WriteSession, claim: Claim, kept: Kept, now: datetime) -> None:
    """Keep the answer to a request, and drop those that have expired."""
    session.execute(delete(IdempotencyKeyRow).where(IdempotencyKeyRow.expires_at <= now))
    session.add(
        IdempotencyKeyRow(
            collection_number=claim.collection,
            scope=claim.scope,
            key=claim.key,
            payload=claim.payload,
            **vars(kept),
            expires_at=claim.expires_at,
        )
    )
