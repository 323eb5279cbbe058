"""Operations on sources: add, list, read, scan, confirm and remove.

Functions that take the id of a source raise SourceNotFoundError if the collection has no such source.
"""

import os
import uuid
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from service.collection import CollectionNumber
from service.errors import BadRequestFieldsError, FieldFault, SourceNotFoundError, SourceRefusedError
from service.shapes import service as shapes_service
from service.shapes.schemas import write_cursor
from service.sources import repository
from service.sources.rules import Rules
from service.sources.schemas import FileState, NewSource, Source, SourceFile, SourceFilePage, Sources
from service.storage.database import Database, ReadSession, WriteSession
from service.storage.tables import SourceRow

AT_ONCE = 100
"""Files whose shapes one transaction deletes."""

REMOVED = "removed"
"""The state of a removed source whose shapes are deleted."""


def real_folder(path: str, allowed: Sequence[str]) -> Path:
    """Return the real path of a folder inside one of some folders.

    Raises
    ------
    SourceRefusedError
        The path is no folder, or is outside.
    """
    if not os.path.isabs(path):
        raise SourceRefusedError(f"{path!r} is not an absolute path")
    real = Path(os.path.realpath(path))
    # The error does not tell whether a folder outside exists.
    if not any(real.is_relative_to(os.path.realpath(root)) for root in allowed):
        raise SourceRefusedError(
            f"{path!r} is in none of the folders of ISOSHAPE_SOURCE_ROOTS; where the service was started, or "
            "with the address of the database in --url, `isoshape library add` adds any folder"
        )
    if not real.is_dir():
        raise SourceRefusedError(f"{path!r} is not a folder")
    return real


def add(session: WriteSession, collection: CollectionNumber, new: NewSource, root: Path) -> Source:
    """Add a folder, whose first scan is asked for.

    Raises
    ------
    SourceRefusedError
        The collection has the folder, or another source of the name.
    BadRequestFieldsError
        A pattern of a rule is none.
    """
    _check(new.rules)
    name = new.name or root.name or "root"
    for other in repository.listed(session, collection):
        if other.root == str(root):
            raise SourceRefusedError(f"the folder is the source {other.name!r} already")
        if other.name == name:
            raise SourceRefusedError(f"another source has the name {name!r}; give this one a name")
    values = {"id": str(uuid.uuid4()), "name": name, "root": str(root), "copies": new.copies}
    row = repository.add(session, collection, {**values, "tags": new.tags, "rules": new.rules})
    return _shown(session, row)


def list_all(session: ReadSession, collection: CollectionNumber) -> Sources:
    """Return the sources of a collection by name."""
    return Sources(sources=[_shown(session, row) for row in repository.listed(session, collection)])


def get(session: ReadSession, collection: CollectionNumber, source_id: str) -> Source:
    """Return a source."""
    return _shown(session, _row(session, collection, source_id))


def list_files(
    session: ReadSession,
    collection: CollectionNumber,
    source_id: str,
    state: FileState | None,
    shape_ids: Sequence[str],
    *,
    equal: bool,
    after: int,
    limit: int,
) -> SourceFilePage:
    """Return one page of the files of a source; see `repository.files`."""
    source = _row(session, collection, source_id)
    total, rows = repository.files(
        session, source.number, state, shape_ids, equal=equal, after=after, limit=limit + 1
    )
    return SourceFilePage(
        files=[SourceFile.of(file, shape_id) for file, shape_id in rows[:limit]],
        total=total,
        next_cursor=write_cursor(rows[limit - 1][0].number) if len(rows) > limit else None,
    )


def set_rules(
    session: WriteSession, collection: CollectionNumber, source_id: str, rules: Mapping[str, list[str]]
) -> Source:
    """Set the rules of a source. The scan that this asks for adds their tags to its shapes.

    Raises
    ------
    BadRequestFieldsError
        A pattern of a rule is none.
    """
    _check(rules)
    source = _row(session, collection, source_id)
    source.rules, source.tagged, source.requested = dict(rules), False, True
    # The other rules may have given a file more tags than a shape may have.
    repository.forget_refused(session, source.number, BadRequestFieldsError.kind)
    session.flush()
    return _shown(session, source)


def _check(rules: Mapping[str, list[str]]) -> None:
    try:
        Rules(rules)
    except ValueError as error:
        raise BadRequestFieldsError(FieldFault("rules", str(error))) from error


def ask_for_scan(
    session: WriteSession, collection: CollectionNumber, source_id: str, *, confirmed: bool = False
) -> Source:
    """Ask for a scan; with `confirmed`, one that takes files for deleted which an offline folder lacks."""
    source = _row(session, collection, source_id)
    source.requested = True
    source.confirmed = source.confirmed or confirmed
    session.flush()
    return _shown(session, source)


def begin_removal(session: WriteSession, collection: CollectionNumber, source_id: str) -> int:
    """Remove a source from the lists and end its scan; return its number, for `delete_shapes`."""
    source = _row(session, collection, source_id)
    source.removed_at = datetime.now(UTC)
    # The service that scans it has lost it.
    source.runner = None
    return source.number


def delete_shapes(database: Database, number: int, keep: timedelta) -> None:
    """Delete the shapes of a removed source that no other source has; they can be restored for `keep`."""
    after = 0
    while True:
        with database.write(deleting=True) as session:
            files = repository.some_files(session, number, after, AT_ONCE)
            if not files:
                repository.change(session, number, {"state": REMOVED})
                return
            for record in repository.lone_shapes(session, files):
                shapes_service.delete(session, repository.collection_of(session, number), record.id, keep)
            after = files[-1]


def forget_removed(database: Database, keep: timedelta) -> None:
    """Finish removals, and forget the sources that were removed before `keep`."""
    with database.read() as session:
        rows = [(source.number, source.state, source.removed_at) for source in repository.removed(session)]
    for number, state, removed_at in rows:
        # Shapes that were restored after that stay.
        if state != REMOVED:
            delete_shapes(database, number, keep)
        if removed_at is not None and removed_at <= datetime.now(UTC) - keep:
            files: Sequence[int] = [0]
            while files:
                with database.write(deleting=True) as session:
                    files = repository.some_files(session, number, 0, AT_ONCE)
                    repository.forget(session, files)
            with database.write(deleting=True) as session:
                repository.erase(session, number)


def _row(session: ReadSession, collection: CollectionNumber, source_id: str) -> SourceRow:
    source = repository.by_id(session, collection, source_id)
    if source is None:
        raise SourceNotFoundError(source_id)
    return source


def _shown(session: ReadSession, source: SourceRow) -> Source:
    return Source.of(source, repository.counts(session, source.number))
