"""The SQL of a collection's rules: tags that its shapes get by their metadata."""

from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

from sqlalchemy import select, update

from service.collection import CollectionNumber
from service.shapes.fields import clean_tags, plain_values
from service.storage.database import ReadSession, WriteSession
from service.storage.tables import CollectionRow

Rules = Mapping[str, Sequence[str]]
"""Tags by conditions, written key=value, of which the value may have the wildcards of a shell."""


def rules_of(session: ReadSession, collection: CollectionNumber) -> dict[str, list[str]]:
    """Return the rules of a collection."""
    return session.scalar(select(CollectionRow.rules).where(CollectionRow.number == collection)) or {}


def set_rules(session: WriteSession, collection: CollectionNumber, rules: Rules) -> None:
    """Set the rules of a collection, for shapes and metadata that are stored from now on."""
    of_collection = update(CollectionRow).where(CollectionRow.number == collection)
    session.execute(of_collection.values(rules={condition: list(tags) for condition, tags in rules.items()}))


def with_rules(
    session: ReadSession, collection: CollectionNumber, tags: Iterable[str], metadata: Mapping[str, Any]
) -> list[str]:
    """Return tags of a shape, and those of the rules that its metadata meet unless there are too many."""
    own, values, added = list(tags), plain_values(dict(metadata)), []
    for condition, given in (rules_of(session, collection) if values else {}).items():
        key, _, pattern = condition.partition("=")
        if key in values and fnmatchcase(values[key].casefold(), pattern.casefold()):
            added += given
    try:
        return clean_tags([*own, *added])
    except ValueError:
        return own
