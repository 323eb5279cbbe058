"""The signatures in memory against those in the database, whatever happens in between."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from service.collection import DEFAULT_COLLECTION
from service.compute.tasks import Embedded
from service.index import signature_table as signatures
from service.index.repository import IndexEntries, entries_since
from service.index.signature_table import SignatureTable
from service.shapes import file_repository, repository
from service.shapes.records import NewFile, NewShape, ShapeRecord
from service.storage.database import Database, ReadSession, migrate
from tests.service.engines import on_both, url_in

pytestmark = on_both

FINGERPRINT = "f" * 16
OTHER = "0" * 16
PIECES = np.ones((1, 6), dtype=np.float32)


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    database = Database(url_in(tmp_path), lock_seconds=5)
    migrate(database)
    yield database
    database.close()


def store(database: Database, content: int, name: str, fingerprint: str = FINGERPRINT) -> None:
    """Store a shape whose signature tells its content and its fingerprint."""
    signature = np.array([content, int(fingerprint, 16) % 97, 0.5], dtype=np.float32)
    views = np.array([content, 8], np.uint8)
    embedded = Embedded(b"record", signature, bytes([content, 1]), views, 0.5, PIECES, {}, {})
    new = NewShape(str(content).encode(), "off", DEFAULT_COLLECTION.number, name, (), {})
    with database.write() as session:
        blob = file_repository.blob_number(session, new.sha256)
        blob = file_repository.add_blob(session, new.data, new.sha256) if blob is None else blob
        if not file_repository.is_embedded(session, fingerprint, new.sha256, "off"):
            file_repository.add_embedding(session, blob, "off", fingerprint, embedded)
            repository.mark_changed(session, blob, "off", embedded.facts)
        if repository.same(session, new.collection, new, name) is None:
            repository.add_shape(session, blob, new, {})


def remove(database: Database, content: int, name: str, *, permanent: bool = True) -> ShapeRecord:
    """Erase a shape, or delete it until it is restored."""
    file = NewFile(str(content).encode(), "off")
    with database.write() as session:
        record = repository.same(session, DEFAULT_COLLECTION.number, file, name)
        assert record is not None
        (repository.erase_shape if permanent else repository.delete_shape)(session, record)
        return record


def current(database: Database, index: SignatureTable) -> IndexEntries:
    with database.read() as session:
        return index.current(session)


def rows(entries: IndexEntries) -> list[tuple[int, int, tuple[float, ...]]]:
    return sorted(
        (int(shape), int(embedding), tuple(signature))
        for shape, embedding, signature in zip(
            entries.shapes, entries.embeddings, entries.signatures.tolist(), strict=True
        )
    )


@pytest.mark.parametrize("seed", range(3))
def test_the_index_is_what_the_database_says_after_any_history(
    database: Database, tmp_path: Path, seed: int
) -> None:
    """Writes come from two connections, and reads from a third."""
    random = np.random.default_rng(seed)
    writers = [Database(url_in(tmp_path), lock_seconds=5) for _ in range(2)]
    indices = [SignatureTable(FINGERPRINT) for _ in range(3)]
    present: list[tuple[int, str]] = []
    held: list[tuple[IndexEntries, list[tuple[int, int, tuple[float, ...]]]]] = []
    deleted: list[tuple[ShapeRecord, tuple[int, str]]] = []
    for step in range(80):
        writer = writers[step % 2]
        act = random.random()
        if act < 0.55 or not present:
            content, name = int(random.integers(12)), f"name {step % 40}"
            fingerprint = OTHER if random.random() < 0.2 else FINGERPRINT
            store(writer, content, name, fingerprint)
            if (content, name) not in present:
                present.append((content, name))
        elif act < 0.8:
            shape = present.pop(int(random.integers(len(present))))
            record = remove(writer, *shape, permanent=act < 0.65)
            if act >= 0.65:
                deleted.append((record, shape))
        elif deleted:
            record, shape = deleted.pop()
            if shape not in present:
                with writer.write() as session:
                    repository.restore_shape(session, record)
                present.append(shape)
        index = indices[int(random.integers(3))]
        if random.random() < 0.6:
            entries = current(database, index)
            with database.read() as session:
                truth = [row for batch in entries_since(session, FINGERPRINT, -1) for row in rows(batch)]
            assert rows(entries) == sorted(truth)
            held.append((entries, rows(entries)))
    for entries, then in held:
        assert rows(entries) == then, "what was handed out has changed"
    for writer in writers:
        writer.close()


def test_an_archive_that_went_back_in_time_is_read_anew(database: Database) -> None:
    index = SignatureTable(FINGERPRINT)
    for content in range(5):
        store(database, content, "name")
    before = rows(current(database, index))
    with database.connect() as connection:
        connection.exec_driver_sql("UPDATE archive SET revision = 3")
        connection.exec_driver_sql("DELETE FROM shapes WHERE number > 2")
    assert rows(current(database, index)) == before[:2]


def test_an_index_that_holds_nothing_does_not_read_what_was_removed(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    for content in range(3):
        store(database, content, "name")
    remove(database, 1, "name")
    asked = []
    removed_since = signatures.repository.removed_since

    def counted(session: ReadSession, since: int) -> NDArray[np.int64]:
        asked.append(since)
        return removed_since(session, since)

    monkeypatch.setattr(signatures.repository, "removed_since", counted)
    index = SignatureTable(FINGERPRINT)
    assert current(database, index).signatures[:, 0].tolist() == [0, 2]
    assert asked == []
    remove(database, 2, "name")
    assert current(database, index).signatures[:, 0].tolist() == [0]
    assert len(asked) == 1
