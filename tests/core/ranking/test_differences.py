"""Coarse differences against the differences of whole embeddings."""

from functools import cache

import numpy as np
import pytest

from core.descriptors.registry import DESCRIPTORS, descriptors_of
from core.descriptors.views import view_signature
from core.embedding import Scores
from core.gallery import CLASSES
from core.pipeline import Pipeline
from core.ranking.differences import CoarseDescriptors, coarse_differences, differences_of
from tests.gallery import make_shape


@cache
def embeddings():
    pipeline = Pipeline()
    return [pipeline.embed(make_shape(label, pose)) for label in CLASSES[:6] for pose in range(2)]


def coarse(chosen):
    shapes = [descriptors_of(one) for one in chosen]
    return CoarseDescriptors(
        np.stack([shape.signature for shape in shapes]),
        np.stack([view_signature(shape.arrays["views"]) for shape in shapes]),
        np.array([shape.reliability for shape in shapes], dtype=np.float32),
    )


def test_spectral_differences_are_exact_and_views_nearly_in_order():
    own, *others = embeddings()
    scores = Pipeline().score(own, others)
    exact = differences_of(descriptors_of(own), [descriptors_of(one) for one in others], scores)
    found = coarse_differences(coarse([own]), coarse(others), scores.cc)
    for name in ("cc", "spectral", "global_distance", "reliability"):
        assert getattr(found, name) == pytest.approx(getattr(exact, name), rel=1e-6, abs=1e-6)
    assert np.corrcoef(found.distances["views"], exact.distances["views"])[0, 1] > 0.75
    assert found.distances["views"] == pytest.approx(exact.distances["views"], rel=0.5)
    assert not found.part.any()
    assert coarse_differences(coarse([own]), coarse(others), part=True).part.all()


def test_typical_distances_stand_for_those_of_skipped_descriptors():
    own, *others = (descriptors_of(one) for one in embeddings())
    none = np.zeros(len(others))
    exact, found = (
        differences_of(own, others, Scores(none, none, none), skipped=skipped)
        for skipped in ((), ("spin_images",))
    )
    for name, distances in found.distances.items():
        if name == "spin_images":
            assert (distances == DESCRIPTORS[name].typical).all()
        else:
            assert distances.tolist() == exact.distances[name].tolist()
    assert (found.part_distance == found.distances["spin_images"]).all()


def test_an_empty_collection_has_no_differences():
    whole = coarse(embeddings()[:1])
    none = CoarseDescriptors(whole.signatures[:0], whole.view_signatures[:0], whole.reliabilities[:0])
    found = coarse_differences(whole, none, np.empty(0))
    arrays = {**vars(found), **found.distances}
    del arrays["distances"]
    assert all(array.shape == (0,) for array in arrays.values())
