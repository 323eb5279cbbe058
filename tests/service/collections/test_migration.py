"""Archives from before there were collections."""

from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import pytest
from sqlalchemy import inspect, text
from sqlalchemy.exc import IntegrityError

from service.collection import DEFAULT_COLLECTION
from service.collections import repository
from service.storage.database import Database
from service.storage.migrate import migrate
from tests.service.archives import begin_at
from tests.service.engines import SQLITE, bare, empty_database, on_both, url_in

pytestmark = on_both

VALUES = {
    "blobs": {"number": 1, "sha256": "a", "size": 1, "data": b"x"},
    "shapes": {"number": 5, "id": "five", "blob_number": 1, "format": "off", "name": "5", "folded_name": "5"}
    | {"meta": "{}", "facts": "{}", "created_at": 0, "updated_at": 0, "revision": 1},
    "shape_tags": {"shape_number": 5, "tag": "kept", "place": 0},
    "shape_metadata": {"shape_number": 5, "key": "key", "value": "kept"},
    "deleted_shapes": {"number": 3, "id": "three", "name": "3", "tags": "[]", "meta": "{}", "format": "off"}
    | {"sha256": "b", "size": 1, "created_at": 0, "deleted_at": 0, "data": b"y"},
    "jobs": {"number": 2, "id": "two", "state": "done", "archive": "a.zip", "format": "zip", "size": 1}
    | {"tags": "[]", "meta": "{}", "created_at": 0},
    "job_pieces": {"job_number": 2, "place": 0, "data": b"z"},
    "idempotency_keys": {"scope": "", "key": "k", "payload": "p", "status": 201, "location": "/shapes/five"}
    | {"body": "{}", "expires_at": 0},
}
"""A row of each table as version 0008 had it; 0 is now."""


@pytest.fixture
def url(tmp_path: Path, engine: str) -> str:
    """Of an archive of the version before, of which the last shapes were deleted."""
    url = url_in(tmp_path) if engine == SQLITE else empty_database()
    begin_at(url, "0008")
    now = datetime.now(UTC).replace(tzinfo=None)
    with bare(url) as connection:
        for table, row in VALUES.items():
            values = {
                key: str(now) if key.endswith("_at") else value
                for key, value in row.items()
                if value is not None
            }
            names = ", ".join(values)
            given = ", ".join(f":{name}" for name in values)
            connection.execute(text(f"INSERT INTO {table} ({names}) VALUES ({given})"), values)
        if engine == SQLITE:
            connection.execute(text("UPDATE sqlite_sequence SET seq = 70 WHERE name = 'shapes'"))
        else:
            connection.execute(text("SELECT setval('shapes_number_seq', 70)"))
    with closing(Database(url, lock_seconds=5)) as database:
        migrate(database)
    return url


def test_stored_shapes_are_in_the_default_collection(url: str) -> None:
    with bare(url) as connection:
        found = connection.execute(text("SELECT number, name FROM collections")).all()
        assert [tuple(row) for row in found] == [(DEFAULT_COLLECTION.number, DEFAULT_COLLECTION.name)]
        for table, row in VALUES.items():
            ((after,),) = (
                (one._mapping,) for one in connection.execute(text(f"SELECT * FROM {table}")).all()
            )
            same = {
                key for key, value in row.items() if after[key] == value or isinstance(after[key], memoryview)
            }
            assert {key for key in row if not key.endswith("_at")} - same <= {"meta", "facts", "tags"}
            if "collection_number" in after:
                assert after["collection_number"] == DEFAULT_COLLECTION.number
    extended = {"shapes", "deleted_shapes", "jobs", "idempotency_keys"}
    with bare(url) as connection:
        told = inspect(connection)
        for table in extended:
            (key,) = [key for key in told.get_foreign_keys(table) if key["referred_table"] == "collections"]
            assert key["constrained_columns"] == ["collection_number"]


def test_no_number_is_given_again(url: str) -> None:
    with closing(Database(url, lock_seconds=5)) as database, database.write() as session:
        repository.add(session, "second")
        second = repository.by_name(session, "second")
        assert second is not None
        assert second.number == DEFAULT_COLLECTION.number + 1
    others = "blob_number, format, name, folded_name, meta, facts, created_at, updated_at, revision"
    columns, copied = f"id, collection_number, {others}", f"'six', {second.number}, {others}"
    with bare(url) as connection:
        # The same bytes under the same name, in another collection.
        connection.execute(text(f"INSERT INTO shapes ({columns}) SELECT {copied} FROM shapes"))
        assert connection.execute(text("SELECT max(number) FROM shapes")).scalar_one() == 71
    again = copied.replace("'six'", "'seven'")
    with pytest.raises(IntegrityError), bare(url) as connection:
        connection.execute(
            text(f"INSERT INTO shapes ({columns}) SELECT {again} FROM shapes WHERE number = 5")
        )


def test_references_to_collections_are_enforced(url: str) -> None:
    with closing(Database(url, lock_seconds=5)) as database:
        with pytest.raises(IntegrityError), database.write() as session:
            session.execute(text("UPDATE shapes SET collection_number = 9"))
        with pytest.raises(IntegrityError), database.write() as session:
            session.execute(text("DELETE FROM collections"))
