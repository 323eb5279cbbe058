"""Changes to all shapes that pass a filter, and by rules, a few in each transaction."""

from typing import Any

from service.collection import CollectionNumber
from service.errors import BadRequestFieldsError, NameTakenError, ServiceError
from service.shapes import repository, service
from service.shapes.bulk_schemas import REFUSED, BulkChange, BulkChanged, Refused
from service.shapes.records import ShapeFilter, ShapeRecord
from service.shapes.rule_repository import with_rules
from service.shapes.schemas import ShapeChanges
from service.storage.database import ReadSession, WriteSession

AT_ONCE = 100
"""Shapes that one transaction changes."""


def matching(session: ReadSession, shapes: ShapeFilter) -> list[int]:
    """Return the numbers of the shapes that pass a filter, ascending."""
    return sorted(repository.numbers(session, shapes))


def would_change(
    session: ReadSession, collection: CollectionNumber, numbers: list[int], wanted: BulkChange, moves: bool
) -> BulkChanged:
    """Count the shapes that a request would change."""
    report = BulkChanged(matched=len(numbers), changed=0, refused=[])
    for start in range(0, len(numbers), AT_ONCE):
        for record in repository.records(session, collection, numbers[start : start + AT_ONCE]):
            try:
                report.changed += moves or bool(_changes(record, wanted))
            except ServiceError as error:
                _refuse(report, record, error)
    return report


def change(
    session: WriteSession,
    collection: CollectionNumber,
    numbers: list[int],
    wanted: BulkChange,
    target: CollectionNumber,
    report: BulkChanged,
) -> None:
    """Change the shapes with some numbers, and count them in a report."""
    for record in repository.records(session, collection, numbers):
        try:
            changes = ShapeChanges(**_changes(record, wanted))
            if target != collection or changes.model_fields_set:
                service.change(session, collection, record.id, changes, target)
                report.changed += 1
        except (BadRequestFieldsError, NameTakenError) as error:
            _refuse(report, record, error)


def tag_by_rules(session: WriteSession, collection: CollectionNumber, numbers: list[int]) -> int:
    """Give some shapes the tags of the rules that their metadata meet; return how many changed."""
    changed = {}
    for record in repository.records(session, collection, numbers):
        tags = with_rules(session, collection, record.tags, record.metadata)
        if tags != list(record.tags):
            changed[record.number] = tags
    if changed:
        repository.set_tags(session, changed)
    return len(changed)


def _changes(record: ShapeRecord, wanted: BulkChange) -> dict[str, Any]:
    """Return the fields of a shape that change, with their values.

    Raise BadRequestFieldsError if they would be more than a shape may have.
    """
    kept = [tag for tag in record.tags if tag not in wanted.remove_tags]
    metadata = {key: value for key, value in record.metadata.items() if key not in wanted.remove_metadata}
    return service.changed_fields(record, [*kept, *wanted.add_tags], metadata | wanted.set_metadata)


def _refuse(report: BulkChanged, record: ShapeRecord, error: ServiceError) -> None:
    if len(report.refused) < REFUSED:
        report.refused.append(Refused(id=record.id, name=record.name, detail=str(error)))
