"""The nearest signatures by PostgreSQL, against those that a plain computation finds."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sqlalchemy import insert, select, text

from core.descriptors.views import SIGNATURE_BYTES, signature_distance
from core.parameters import DEFAULT
from service.collection import DEFAULT_COLLECTION
from service.search.repository import nearest
from service.shapes import file_repository, repository
from service.shapes.records import NewShape, ShapeFilter
from service.storage.database import Database, ReadSession
from service.storage.postgresql import M, ensure_hnsw, index_name
from service.storage.tables import BlobRow, CoarseSamplesRow, EmbeddingRow, ShapeRow, TagRow
from tests.service.archives import embedded
from tests.service.engines import empty_database, on_postgresql

pytestmark = on_postgresql

SHAPES = 6_000
LENGTH = 33
GROUPS = 40
WANTED = 100
FINGERPRINT, OTHER = "f" * 16, "0" * 16
EVERYTHING = ShapeFilter(DEFAULT_COLLECTION.number)


@dataclass(frozen=True, eq=False)
class Stored:
    """Shapes 1 to `SHAPES`: their signatures and view signatures, and queries near some of them.

    View signatures of queries come last.
    """

    database: Database
    signatures: NDArray[np.float32]
    queries: NDArray[np.float32]
    view_signatures: NDArray[np.uint8]

    def truth(self, query: NDArray[np.float32], among: NDArray[np.int64] | None = None) -> NDArray[np.int64]:
        """The numbers of the shapes, nearest first."""
        numbers = np.arange(1, SHAPES + 1) if among is None else among
        distances = np.linalg.norm(self.signatures[numbers - 1].astype(np.float64) - query, axis=1)
        return numbers[np.lexsort((numbers, distances))]

    def is_sorted(self, numbers: NDArray[np.int64], query: NDArray[np.float32]) -> bool:
        """Whether the distances of shapes from a query ascend, to single precision."""
        distances = np.linalg.norm(self.signatures[numbers - 1].astype(np.float64) - query, axis=1)
        return bool((np.diff(distances) >= -1e-5).all())

    def nearest(
        self, query: NDArray[np.float32], count: int, shapes: ShapeFilter = EVERYTHING, ef: int | None = None
    ) -> NDArray[np.int64]:
        with self.database.read() as session:
            return nearest(session, FINGERPRINT, query, count, shapes=shapes, ef_search=ef)


@pytest.fixture(scope="module")
def stored(engine: str) -> Iterator[Stored]:
    """Groups of signatures; a tag on every third shape and another on 30; another pipeline's beside them."""
    rng = np.random.default_rng(7)
    middles = rng.normal(size=(GROUPS, LENGTH))
    points = middles[rng.integers(GROUPS, size=SHAPES + 20)] + 0.4 * rng.normal(size=(SHAPES + 20, LENGTH))
    signatures, queries = np.split(points.astype(np.float32), [SHAPES])
    groups = rng.integers(0, 40, size=(GROUPS, SIGNATURE_BYTES))
    noise = rng.integers(0, 20, size=(SHAPES + 20, SIGNATURE_BYTES))
    view_signatures = (groups[rng.integers(GROUPS, size=SHAPES + 20)] + noise).astype(np.uint8)
    numbers = range(1, SHAPES + 1)
    url = empty_database(migrated=True)
    with closing(Database(url, lock_seconds=60)) as database:
        with database.write() as session:
            rows = session.connection()
            blob = {"size": 1, "data": b"x"}
            rows.execute(insert(BlobRow), [{**blob, "number": n, "sha256": f"{n}"} for n in numbers])
            shared: dict[str, Any] = {
                "format": "off",
                "folded_name": "",
                "meta": {},
                "revision": 1,
                "checksum": "",
            }
            shared |= dict.fromkeys(("created_at", "updated_at"), datetime.now(UTC))
            rows.execute(
                insert(ShapeRow),
                [
                    {
                        **shared,
                        "number": n,
                        "id": f"{n}",
                        "collection_number": DEFAULT_COLLECTION.number,
                        "blob_number": n,
                        "name": f"{n}",
                        "facts": {"area": n},
                    }
                    for n in numbers
                ],
            )
            for fingerprint, vectors in ((FINGERPRINT, signatures), (OTHER, signatures[:, :5])):
                made = {"format": "off", "fingerprint": fingerprint, "record": b"", "checksum": ""}
                rows.execute(
                    insert(EmbeddingRow),
                    [{**made, "blob_number": n, "signature": vectors[n - 1]} for n in numbers],
                )
            tagged = [(n, "third") for n in numbers if n % 3 == 0] + [(n, "few") for n in range(200, 230)]
            rows.execute(
                insert(TagRow), [{"shape_number": n, "tag": tag, "position": 0} for n, tag in tagged]
            )
            own = [n for (n,) in rows.execute(select(EmbeddingRow.number).order_by(EmbeddingRow.number))]
            sketches = zip(own, view_signatures[:SHAPES], strict=False)
            sketch = {"data": b"", "signature": b"", "reliability": 1.0, "checksum": ""}
            rows.execute(
                insert(CoarseSamplesRow),
                [{**sketch, "embedding_number": n, "view_signature": each} for n, each in sketches],
            )
            assert ensure_hnsw(session, FINGERPRINT, m=12, ef_construction=50)
            assert ensure_hnsw(session, OTHER, m=12, ef_construction=50)
        with database.connect() as connection:
            connection.execute(text("ANALYZE"))
        yield Stored(database, signatures, queries, view_signatures)


def recall(found: NDArray[np.int64], truth: NDArray[np.int64]) -> float:
    return len(np.intersect1d(found, truth)) / len(truth)


def test_the_exact_search_finds_what_a_plain_one_does(stored: Stored) -> None:
    for query in stored.queries:
        np.testing.assert_array_equal(stored.nearest(query, WANTED), stored.truth(query)[:WANTED])


@pytest.mark.parametrize("ef", [None, 200])
@pytest.mark.parametrize("tag", [None, "third"])
def test_the_nearest_views_are_those_of_a_plain_search(
    stored: Stored, ef: int | None, tag: str | None
) -> None:
    shapes = ShapeFilter(DEFAULT_COLLECTION.number, tags=() if tag is None else (tag,))
    numbers = np.arange(1, SHAPES + 1) if tag is None else np.arange(3, SHAPES + 1, 3)
    for query in stored.view_signatures[SHAPES:]:
        distances = signature_distance(query, stored.view_signatures[numbers - 1])
        truth = numbers[np.lexsort((numbers, distances))][:WANTED]
        with stored.database.read() as session:
            found = nearest(session, FINGERPRINT, query, WANTED, shapes=shapes, ef_search=ef, views=True)
        if ef is None:
            np.testing.assert_array_equal(found, truth)
        else:
            assert recall(found, truth) >= 0.9


def test_the_graph_misses_next_to_nothing(stored: Stored) -> None:
    shares = [
        recall(stored.nearest(query, WANTED, ef=200), stored.truth(query)[:WANTED])
        for query in stored.queries
    ]
    assert np.mean(shares) >= 0.99
    for query in stored.queries[:3]:
        found = stored.nearest(query, WANTED, ef=200)
        assert stored.is_sorted(found, query)
        assert len(np.unique(found)) == WANTED


def test_the_answers_of_the_graph_are_put_in_order(stored: Stored) -> None:
    """A narrow search goes on in turns: each may bring what is nearer than the last one's."""
    many = 300
    shares = {}
    for more in (1, 4):
        found = []
        for query in stored.queries:
            with stored.database.read() as session:
                session.execute(text("SET LOCAL enable_seqscan = off"))
                found.append(
                    nearest(session, FINGERPRINT, query, many, shapes=EVERYTHING, ef_search=1, more=more)
                )
            assert stored.is_sorted(found[-1], query)
        truth = [stored.truth(query)[:many] for query in stored.queries]
        shares[more] = np.mean([recall(*each) for each in zip(found, truth, strict=True)])
    assert shares[4] > shares[1]


def test_the_graph_is_what_is_searched(stored: Stored, monkeypatch: pytest.MonkeyPatch) -> None:
    plans: dict[int | None, str] = {}

    def explained(ef: int | None) -> None:
        execute = ReadSession.execute

        def explain(session: ReadSession, statement: object, *rest: object) -> object:
            written = statement.compile(session.get_bind(), compile_kwargs={"literal_binds": True})  # type: ignore[attr-defined]
            if "distance" in str(written):
                plan = execute(session, text("EXPLAIN " + str(written).replace(":", r"\:"))).scalars().all()
                plans[ef] = "\n".join(plan)
            return execute(session, statement, *rest)  # type: ignore[call-overload]

        with monkeypatch.context() as patch:
            patch.setattr(ReadSession, "execute", explain)
            stored.nearest(stored.queries[0], 20, ef=ef)

    explained(100)
    explained(None)
    assert f"Index Scan using {index_name(FINGERPRINT)}" in plans[100]
    assert "signatures_" not in plans[None]


@pytest.mark.parametrize("ef", [None, 200])
def test_only_what_the_filter_means_is_found(stored: Stored, ef: int | None) -> None:
    thirds = np.arange(3, SHAPES + 1, 3)
    small = np.arange(50, 2_001)
    for query in stored.queries[:8]:
        for shapes, meant in (
            (ShapeFilter(DEFAULT_COLLECTION.number, tags=("third",)), thirds),
            (ShapeFilter(DEFAULT_COLLECTION.number, area=(50, 2_000)), small),
            (
                ShapeFilter(DEFAULT_COLLECTION.number, tags=("third",), area=(50, 2_000)),
                np.intersect1d(thirds, small),
            ),
            (
                ShapeFilter(
                    DEFAULT_COLLECTION.number, excluded=tuple(str(n) for n in stored.truth(query)[:5])
                ),
                stored.truth(query)[5:],
            ),
        ):
            found, truth = stored.nearest(query, WANTED, shapes, ef), stored.truth(query, meant)[:WANTED]
            assert np.isin(found, meant).all()
            assert len(found) == WANTED
            assert recall(found, truth) >= (1.0 if ef is None else 0.97)


@pytest.mark.parametrize("ef", [None, 1, 200])
def test_all_are_found_where_a_filter_means_few(stored: Stored, ef: int | None) -> None:
    few = np.arange(200, 230)
    for query in stored.queries[:5]:
        found = stored.nearest(query, WANTED, ShapeFilter(DEFAULT_COLLECTION.number, tags=("few",)), ef)
        np.testing.assert_array_equal(found, stored.truth(query, few))
    nothing = stored.nearest(
        stored.queries[0], WANTED, ShapeFilter(DEFAULT_COLLECTION.number, tags=("nobody has it",)), ef
    )
    assert len(nothing) == 0


def test_each_pipeline_has_its_own(stored: Stored) -> None:
    query = stored.queries[0][:5]
    distances = np.linalg.norm(stored.signatures[:, :5].astype(float) - query, axis=1)
    with stored.database.read() as session:
        found = nearest(session, OTHER, query, 10, shapes=EVERYTHING, ef_search=None)
        by_graph = nearest(session, OTHER, query, 10, shapes=EVERYTHING, ef_search=200)
    np.testing.assert_array_equal(found, np.argsort(distances)[:10] + 1)
    assert recall(by_graph, found) >= 0.9


def test_a_graph_is_made_with_the_first_signature_and_anew_for_other_parameters() -> None:
    url = empty_database(migrated=True)

    def graphs(**parameters: int) -> list[str]:
        with database.write() as session:
            ensure_hnsw(session, DEFAULT.fingerprint, **parameters)
            found = text("SELECT indexdef FROM pg_indexes WHERE indexdef LIKE '%hnsw%' ORDER BY indexname")
            return list(session.scalars(found))

    with closing(Database(url, lock_seconds=5)) as database:
        for number in (1, 2):
            new, made = (
                NewShape(b"%d" % number, "off", DEFAULT_COLLECTION.number, "x", (), {}),
                embedded(number),
            )
            assert len(graphs()) == 2 * (number - 1)
            with database.write() as session:
                blob = file_repository.add_blob(session, new.data, new.sha256)
                file_repository.add_embedding(session, blob, "off", DEFAULT.fingerprint, made)
                repository.add_shape(session, blob, new, {})
            signatures, views = graphs()
            assert f"vector({len(made.signature)})" in signatures
            assert DEFAULT.fingerprint in signatures
            assert f"vector({SIGNATURE_BYTES})) vector_l1_ops" in views
            assert all(f"m='{M}'" in graph for graph in (signatures, views))
        with database.read() as session:
            found = nearest(session, DEFAULT.fingerprint, made.signature, 5, shapes=EVERYTHING, ef_search=40)
            views = made.view_signature
            alike = nearest(
                session, DEFAULT.fingerprint, views, 5, shapes=EVERYTHING, ef_search=40, views=True
            )
        assert all("m='20', ef_construction='90'" in graph for graph in graphs(m=20, ef_construction=90))
        assert found.tolist() == [2, 1]
    assert alike.tolist() == [2, 1]
