"""Which stored shapes a query is compared with, and in what order they come."""

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from core.descriptors.views import signature_distance
from core.ranking.shortlist import signature_distances
from service.index.repository import IndexEntries
from service.search.records import Candidates, MatchedCandidates
from service.search.results import ranked
from service.search.schemas import RankBy
from tests.service.engines import on_both
from tests.service.support import Running, query, serving, settings_in, small_file

pytestmark = on_both

STORED = 12


@pytest.fixture(scope="module")
def small_shortlist(tmp_path_factory: pytest.TempPathFactory, engine: str) -> Iterator[Running]:
    """A service that shortlists 4 from 10 candidates up, and holds 12 shapes."""
    folder = tmp_path_factory.mktemp("shortlist")
    with serving(settings_in(folder, shortlist_from=10, shortlist_length=4)) as running:
        for number in range(STORED):
            running.store(small_file(number), f"{number}.off", tags=["few"] if number < 9 else ["many"])
        yield running


def test_a_large_collection_is_compared_by_its_nearest_signatures_and_views(small_shortlist: Running) -> None:
    client = small_shortlist.client
    shapes = {shape["name"]: shape["id"] for shape in client.get("/shapes").json()["shapes"]}
    with small_shortlist.container.database.read() as session:
        entries = small_shortlist.container.pipelines.current(session).index.current(session)
    views = dict(zip(shapes, entries.view_signatures, strict=True))
    signatures = {
        name: np.array(client.get(f"/shapes/{shape_id}/embedding").json()["signature"], dtype=np.float32)
        for name, shape_id in shapes.items()
    }
    stacked = np.array(list(signatures.values()))
    unions = set()
    for name, shape_id in shapes.items():
        distances = signature_distances(signatures[name], stacked)
        view_distances = signature_distance(views[name], np.stack(list(views.values())))
        nearest = sorted(zip(distances, range(STORED), shapes, strict=True))[:4]
        alike = sorted(zip(view_distances, range(STORED), shapes, strict=True))[:2]
        union = {one for _, _, one in nearest + alike}
        unions.add(len(union))
        body = {"shape_id": shape_id, "top_k": 100, "exclude_self": False}
        answer = client.post("/query", json=body).json()
        assert (answer["compared"], answer["stored"]) == (len(union), STORED)
        assert {result["shape"]["name"] for result in answer["results"]} == union
        assert answer["results"][0]["shape"]["name"] == name
    assert max(unions) > 4


def test_all_are_compared_when_asked_or_when_few(small_shortlist: Running) -> None:
    data = small_file(20)
    whole = query(small_shortlist.client, data, exhaustive="true", top_k=100).json()
    assert whole["compared"] == len(whole["results"]) == STORED
    few = query(small_shortlist.client, data, tag="few", top_k=100).json()
    assert (few["compared"], few["stored"]) == (9, STORED)
    shortlisted = query(small_shortlist.client, data, top_k=100).json()
    scores = {result["shape"]["id"]: result["cc"] for result in whole["results"]}
    assert {r["shape"]["id"]: r["cc"] for r in shortlisted["results"]}.items() <= scores.items()


def matched_of(shapes: NDArray[np.int64], *scores: NDArray[np.float64]) -> MatchedCandidates:
    """Return shapes with their CC, SSD, sim and log odds."""
    none = np.empty((len(shapes), 0), np.uint8)
    signatures = none.astype(np.float32)
    entries = IndexEntries(shapes, shapes, shapes, signatures, none, none, np.zeros(len(shapes), np.float32))
    return MatchedCandidates(Candidates(entries, shortlisted=False, stored=len(shapes)), *scores)


@pytest.mark.parametrize("by", ["cc", "ssd", "sim", "combined"])
def test_ranking_is_a_stable_sort_by_likeness(by: RankBy) -> None:
    random = np.random.default_rng(0)
    n = 200
    shapes = random.permutation(n)
    cc, ssd, sim, log_odds = (random.integers(0, 6, n) / 6 for _ in range(4))
    order = ranked(matched_of(shapes, cc, ssd, sim, log_odds), by)
    value = {"cc": -cc, "ssd": ssd, "sim": -sim, "combined": -log_odds}[by]
    assert order.tolist() == sorted(range(n), key=lambda i: (value[i], ssd[i], shapes[i]))
