"""How many candidates each stage of a search by class probability passes on."""

from collections.abc import Sequence
from typing import Any

import pytest

from core.arrays import Bytes, Float32s
from core.descriptors.registry import ShapeDescriptors
from core.evaluation.perturbation import cut_part
from core.io import write_mesh
from core.parameters import Parameters
from core.ranking.reranking import rerank
from service.search import repository, scoring
from service.search.caches import CandidateReader
from service.storage.database import ReadSession
from tests.gallery import make_shape
from tests.service.support import Running, module_service, query, small_file

LENGTHS = {"shortlist_from": 5, "shortlist_length": 9, "finalists": 2}
STORED = 12


stocked = module_service(
    stored={f"{number}.off": small_file(number) for number in range(STORED)}, search_bytes=0, **LENGTHS
)


def test_all_candidates_of_an_incomplete_query_are_described(
    stocked: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    reranked: list[int] = []
    described: list[int] = []
    descriptors = CandidateReader.descriptors

    def counted(record: Float32s, samples: Bytes, parameters: Parameters) -> Float32s:
        reranked.append(len(samples))
        return rerank(record, samples, parameters)

    def read_descriptors(reader: CandidateReader, numbers: Sequence[int]) -> dict[int, ShapeDescriptors]:
        described.extend(numbers)
        return descriptors(reader, numbers)

    monkeypatch.setattr(scoring, "rerank", counted)
    monkeypatch.setattr(CandidateReader, "descriptors", read_descriptors)
    cup = make_shape("cup", 0)
    for mesh, count in ((cup, 3), (cut_part(cup, 0.5, 1), 9)):
        reranked.clear()
        described.clear()
        answer = query(stocked.client, write_mesh(mesh, "off"), rank_by="combined", top_k=1).json()
        assert answer["compared"] == LENGTHS["finalists"] + 1
        assert (sum(reranked), len(set(described))) == (LENGTHS["shortlist_length"], count)


@pytest.mark.parametrize("options", [{"rank_by": "combined"}, {"exhaustive": True, "correspondences": True}])
def test_a_query_reads_each_record_once(
    stocked: Running, monkeypatch: pytest.MonkeyPatch, options: dict[str, Any]
) -> None:
    """Even without any cache: match records, descriptors, likeness and correspondences share one read."""
    stocked.container.descriptors.resize(0)
    query(stocked.client, small_file(0), **options)
    read: list[int] = []
    embedding_records = repository.embedding_records

    def counted(session: ReadSession, numbers: Sequence[int]) -> dict[int, bytes]:
        read.extend(numbers)
        return embedding_records(session, numbers)

    monkeypatch.setattr(repository, "embedding_records", counted)
    answer = query(stocked.client, small_file(0), top_k=2, **options).json()
    assert len(answer["results"]) == 2
    assert sorted(set(read)) == sorted(read) != []
