"""Words beside shapes: which names a query finds, in which order, and that the index follows every change."""

from collections.abc import Iterator

import pytest

from service.collection import DEFAULT_COLLECTION
from service.shapes import repository
from service.shapes.records import ShapeFilter
from service.storage.database import Database
from service.storage.tables import ShapeWordRow, WordRow
from service.storage.words import words_of
from tests.service.engines import on_both, url_in
from tests.service.support import Running, query, small_file
from tests.studies.words import LEAST, QUERIES, archive_of, found, made_names, recall

pytestmark = on_both

MADE = 400


@pytest.fixture(scope="module")
def named(tmp_path_factory: pytest.TempPathFactory, engine: str) -> Iterator[Database]:
    names = [*QUERIES.values(), *made_names(MADE)]
    with archive_of(names, url_in(tmp_path_factory.mktemp("words"))) as database:
        yield database


def test_what_makers_write_finds_what_they_mean(named: Database) -> None:
    hits = recall(named)
    assert sum(hits.values()) >= LEAST * len(hits)


@pytest.mark.parametrize(
    "wanted",
    ["Entonnoir", "entonoir", "entonnnoir", "entonnior", "emtonnoir", "ntonnoir", "entonnoirs", "entonnoi"],
)
def test_one_edit_of_a_word_finds_it(named: Database, wanted: str) -> None:
    assert found(named, wanted) == ["entonnoir_80mm.stl"]


@pytest.mark.parametrize(
    "wanted", ["entnoir", "entonnoir crochet", "gaer", "%", "_", "'", "\\", "\U0010ffff"]
)
def test_what_no_shape_has_finds_nothing(named: Database, wanted: str) -> None:
    assert found(named, wanted) == []


def test_the_most_relevant_come_first_page_by_page(named: Database) -> None:
    shapes = ShapeFilter(DEFAULT_COLLECTION.number, words="boîte")
    with named.read() as session:
        whole, total = repository.page(session, shapes, after=None, limit=500, sort="relevance")
        assert len(whole) == total == repository.count(session, shapes) > 10
        paged, after = [], None
        while True:
            page, total = repository.page(session, shapes, after=after, limit=7, sort="relevance")
            assert total == len(whole)
            if not page:
                break
            paged += page
            after, _ = page[-1]
    assert paged == whole
    points = [position.points for position, _ in whole]
    assert points == sorted(points, reverse=True)


def test_lists_and_queries_take_words(service: Running) -> None:
    stored = [
        service.store(small_file(0), name="Zahnrad M8.off", tags="blau"),
        service.store(small_file(1), name="M8 washer.off"),
        service.store(small_file(2), name="lamp.off", metadata='{"fits": ["Zahnräder"]}'),
    ]
    client = service.client

    def listed(**wanted: str) -> list[str]:
        return [shape["id"] for shape in client.get("/shapes", params=wanted).json()["shapes"]]

    gear, washer, lamp = (shape["id"] for shape in stored)
    assert listed(q="zahnrad") == [gear, lamp]
    assert listed(q="zahnrad", sort="newest") == [lamp, gear]
    assert listed(q="Zahnrad blau") == [gear]
    assert listed(q="") == [gear, washer, lamp]
    answer = query(client, small_file(1), top_k=9, q="m8").json()
    assert [result["shape"]["id"] for result in answer["results"]] == [washer, gear]
    assert answer["compared"] == 2
    assert client.get("/facets", params={"q": "zahnrad"}).json()["total"] == 2
    first = client.get("/shapes", params={"q": "m8", "limit": 1}).json()
    rest = client.get("/shapes", params={"q": "m8", "cursor": first["next_cursor"]}).json()
    assert [shape["id"] for shape in (*first["shapes"], *rest["shapes"])] == [gear, washer]
    assert client.get("/shapes", params={"cursor": first["next_cursor"]}).status_code == 422


def test_the_index_follows_every_change(service: Running) -> None:
    client = service.client
    shape = service.store(small_file(0), name="cup.off", tags="red,cup", metadata='{"maker": "Ann"}')["id"]
    other = service.store(small_file(1), name="red bowl.off")["id"]

    def check(**expected: tuple[str, list[str], dict[str, str]]) -> None:
        """The words of each shape are in the index, and no others."""
        own = [words_of(*fields) for fields in expected.values()]
        assert service.rows(ShapeWordRow) == sum(map(len, own))
        assert service.rows(WordRow) == len({word for words in own for word in words})

    bowl = ("red bowl.off", [], {})
    check(cup=("cup.off", ["red", "cup"], {"maker": "Ann"}), bowl=bowl)
    client.patch(f"/shapes/{shape}", json={"name": "mug.off", "tags": ["blue"]})
    check(mug=("mug.off", ["blue"], {"maker": "Ann"}), bowl=bowl)
    client.patch(f"/shapes/{shape}", json={"metadata": {"maker": "Bob"}})
    check(mug=("mug.off", ["blue"], {"maker": "Bob"}), bowl=bowl)
    client.put("/collections/words")
    client.patch(f"/shapes/{shape}", json={"collection": "words"})
    check(mug=("mug.off", ["blue"], {"maker": "Bob"}), bowl=bowl)
    assert client.get("/shapes", params={"q": "mug"}).json()["total"] == 0
    assert client.get("/shapes", params={"q": "mug", "collection": "words"}).json()["total"] == 1
    client.delete(f"/shapes/{shape}", params={"collection": "words", "permanent": True})
    check(bowl=bowl)
    client.delete(f"/shapes/{other}")
    check()
    assert client.delete("/collections/words").status_code == 204
