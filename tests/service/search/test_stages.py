"""How many candidates each stage of a search by class probability passes on."""

from pathlib import Path

import pytest
from sqlalchemy import delete, update

from core.arrays import Floats, Ints
from core.embedding import Embedding
from core.evaluation.perturbation import cut_part
from core.gallery import make_shape
from core.io import write_mesh
from core.ranking.reranking import quantised_points
from service.container import Container
from service.search import match_records, scoring
from service.search.match_records import QueryScorer
from service.search.records import Query
from service.search.shortlist import Candidates
from service.storage.tables import QuantisedPointsRow
from tests.service.support import query, serving, settings_in, small_file

LENGTHS = {"shortlist_from": 5, "shortlist_length": 9, "reranked": 6, "finalists": 2}
STORED = 12


def test_more_candidates_of_an_incomplete_query_are_reranked_and_described(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reranked: list[int] = []
    described: list[int] = []
    rerank, class_scores = QueryScorer.rerank, scoring.class_scores

    def counted(scorer: QueryScorer, embeddings: Ints) -> Floats:
        reranked.append(len(embeddings))
        return rerank(scorer, embeddings)

    async def scored(container: Container, asked: Query, candidates: Candidates, *scores: Floats) -> Floats:
        described.append(len(candidates.shapes))
        return await class_scores(container, asked, candidates, *scores)

    monkeypatch.setattr(QueryScorer, "rerank", counted)
    monkeypatch.setattr(scoring, "class_scores", scored)
    cup = make_shape("cup", 0)
    with serving(settings_in(tmp_path, **LENGTHS)) as running:
        for number in range(STORED):
            running.store(small_file(number), f"{number}.off")
        # Of an incomplete query, twice as many candidates would be re-ranked as there are.
        for mesh, counts in ((cup, (6, 3)), (cut_part(cup, 0.5, 1), (9, 9))):
            reranked.clear()
            described.clear()
            answer = query(running.client, write_mesh(mesh, "off"), rank_by="combined", top_k=1).json()
            assert answer["compared"] == LENGTHS["finalists"] + 1
            assert (sum(reranked), described[0]) == counts


def test_without_whole_points_the_embedding_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Embedding] = []

    def counted(embedding: Embedding) -> bytes:
        made.append(embedding)
        return quantised_points(embedding)

    with serving(settings_in(tmp_path, **LENGTHS, search_bytes=0)) as running:
        for number in range(STORED):
            running.store(small_file(number), f"{number}.off")

        def answer() -> list[tuple[str, float]]:
            found = query(running.client, small_file(STORED), rank_by="cc", top_k=2).json()
            return [(each["shape"]["name"], each["cc"]) for each in found["results"]]

        monkeypatch.setattr(match_records, "quantised_points", counted)
        before = answer()
        assert not made
        some = QuantisedPointsRow.embedding_number % 2 == 0
        for statement in (
            update(QuantisedPointsRow).values(data=b"damaged."),
            delete(QuantisedPointsRow).where(some),
        ):
            with running.container.database.write() as session:
                session.execute(statement)
            made.clear()
            assert answer() == before
            assert len(made) == LENGTHS["reranked"]
