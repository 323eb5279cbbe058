"""The plans by which SQLite finds the pieces of some sizes, and their shapes."""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import event

from core.parameters import DEFAULT
from service.collection import DEFAULT_COLLECTION
from service.search.repository import pieces, shapes_of
from service.shapes.records import ShapeFilter
from service.storage.database import Database, ReadSession, migrate

FILTER = ShapeFilter(DEFAULT_COLLECTION.number)


@pytest.mark.parametrize(
    ("read", "steps"),
    [
        (
            lambda session: pieces(session, [(0.9, 1.1)], of_several=True),
            ["SEARCH pieces USING COVERING INDEX pieces_by_size (of_several=? AND size>? AND size<?)"],
        ),
        (
            lambda session: shapes_of(session, DEFAULT.fingerprint, FILTER, np.arange(50)),
            [
                "SEARCH embeddings USING INTEGER PRIMARY KEY (rowid=?)",
                "SEARCH shapes USING INDEX shapes_by_blob (blob_number=? AND format=?)",
            ],
        ),
    ],
)
def test_only_rows_that_match_are_read(
    tmp_path: Path, read: Callable[[ReadSession], Any], steps: list[str]
) -> None:
    """The other way round, SQLite reads the rows of every shape: half a second among 500,000."""
    with closing(Database(f"sqlite:///{tmp_path}/archive.sqlite3", lock_seconds=10.0)) as database:
        migrate(database)
        asked: list[tuple[str, Any]] = []
        with database.read() as session:
            connection = session.connection()
            event.listen(
                connection, "before_cursor_execute", lambda *given: asked.append((given[2], given[3]))
            )
            read(session)
            ((statement, values),) = asked
            plan = connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {statement}", values).all()
    assert [row[3] for row in plan if row[3].startswith("SEARCH")] == steps
