"""A descriptor that is added to the table is in embeddings, in their records and among the differences."""

from dataclasses import replace

import numpy as np
import pytest
import zstandard
from safetensors.numpy import load, save

from core.descriptors.registry import DESCRIPTORS, Descriptor, descriptors_of
from core.embedding import Embedding, Scores
from core.errors import BadRecordError
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.differences import CoarseDescriptors, coarse_differences, differences_of
from core.serialization import descriptors_from_bytes, embedding_from_bytes, embedding_to_bytes
from tests.core.shapes import blob, box

TOY = Descriptor(
    shapes=((2,),),
    dtype=np.float32,
    compute=lambda surface: np.array(
        [len(surface.cleaned.vertices), surface.boundary_ratio], dtype=np.float32
    ),
    distance=lambda query, others: np.array([abs(float(query[0] - other[0])) for other in others]),
    typical=3.0,
)


@pytest.fixture
def embeddings(monkeypatch: pytest.MonkeyPatch) -> list[Embedding]:
    monkeypatch.setitem(DESCRIPTORS, "toy", TOY)
    return [Pipeline(DEFAULT).embed(mesh) for mesh in (blob(0, 2), box(3, 2, 1))]


def test_a_new_descriptor_is_embedded_and_recorded(embeddings: list[Embedding]) -> None:
    assert [embedding.descriptors["toy"].tolist() for embedding in embeddings] == [[162.0, 0.0], [8.0, 0.0]]
    for embedding in embeddings:
        record = embedding_to_bytes(embedding)
        for arrays in (embedding_from_bytes(record).descriptors, descriptors_from_bytes(record).arrays):
            assert list(arrays) == list(DESCRIPTORS)
            for name, array in arrays.items():
                np.testing.assert_array_equal(array, embedding.descriptors[name])


def test_its_distances_are_among_the_differences(embeddings: list[Embedding]) -> None:
    query, *_ = shapes = [descriptors_of(embedding) for embedding in embeddings]
    none = np.zeros(2)
    differences = differences_of(query, shapes, Scores(none, none, none))
    assert differences.distances["toy"].tolist() == [0.0, 154.0]
    assert query.nbytes == sum(array.nbytes for array in (query.signature, *query.arrays.values()))
    short = CoarseDescriptors(query.signature[None], np.zeros((1, 4), np.uint8), np.ones(1, np.float32))
    assert coarse_differences(short, short).distances["toy"].tolist() == [3.0]


@pytest.mark.parametrize("array", [np.zeros(3, np.float32), np.zeros(2), np.full(2, np.nan, np.float32)])
def test_a_record_whose_array_is_not_of_its_kind_is_refused(
    embeddings: list[Embedding], array: np.ndarray
) -> None:
    bad = replace(embeddings[0], descriptors={**embeddings[0].descriptors, "toy": array})
    with pytest.raises(BadRecordError, match="toy"):
        embedding_from_bytes(embedding_to_bytes(bad))
    arrays = load(zstandard.decompress(embedding_to_bytes(embeddings[0])))
    del arrays["toy"]
    with pytest.raises(BadRecordError, match="toy"):
        embedding_from_bytes(zstandard.compress(save(arrays)))
