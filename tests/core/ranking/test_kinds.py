"""Kinds of nearly isometric shapes: their metric against a plain covariance, and individuals told apart."""

import numpy as np
import pytest

from core.arrays import Floats
from core.descriptors.eigenvalues import TREND, eigenvalue_coordinates
from core.descriptors.views import VIEW_BYTES
from core.ranking.kinds import (
    COPY,
    FOLDS,
    MESH_NOISE,
    MESHES,
    MIXING,
    NEIGHBOURS,
    NO_KIND,
    RELATIVE_DISTANCE,
    RISE,
    ROUNDS,
    SCALE,
    Kinds,
    kinds_in,
    without_kinds,
)
from core.spectral.spectral_embedding import SPECTRUM

BODIES, POSES = 8, 12


def posed_bodies(seed: int, centre: float = 0.0, *, bodies: int = BODIES, poses: int = POSES) -> Floats:
    """Log eigenvalues of bodies that differ less than their poses do, shape (bodies * poses, SPECTRUM).

    Poses move them along three directions, the same for all bodies.
    """
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(3, SPECTRUM))
    means = centre + rng.normal(scale=0.01, size=(bodies, 1, SPECTRUM))
    steps = rng.normal(scale=0.01, size=(bodies, poses, 3)) @ directions
    return (means + steps).reshape(-1, SPECTRUM)


def kinds_of(logarithms: Floats) -> Kinds:
    """Return the kinds among shapes that all look different."""
    views = np.random.default_rng(0).integers(256, size=(len(logarithms), VIEW_BYTES), dtype=np.uint8)
    return kinds_in(logarithms, views)


def all_distances(sample: Floats, logarithms: Floats) -> Floats:
    kinds = kinds_of(sample)
    found = kinds.of(logarithms)
    return np.array([kinds.of(row[None]).distances(found) for row in logarithms])


def first_tier(distances: Floats) -> float:
    """Share of the poses of a shape's body among as many nearest shapes."""
    others = np.where(np.eye(len(distances), dtype=bool), np.inf, distances)
    nearest = others.argsort(axis=1)[:, : POSES - 1]
    return float((nearest // POSES == np.arange(len(distances))[:, None] // POSES).mean())


def test_individuals_are_told_apart_in_poses_that_differ_more_than_they_do() -> None:
    logarithms = posed_bodies(0)
    coordinates = eigenvalue_coordinates(logarithms)
    assert first_tier(np.abs(coordinates[:, None] - coordinates).sum(axis=2)) < 0.5
    assert first_tier(all_distances(logarithms, logarithms)) > 0.8


def inverse_covariance(sample: Floats, pairs: list[tuple[int, int]]) -> Floats:
    steps = np.array([sample[b] - sample[a] for a, b in pairs])
    noise = MESH_NOISE**2 * np.diag(np.arange(1, SPECTRUM + 1) / 10) + np.outer(TREND, TREND)
    return np.linalg.inv((steps.T @ steps / 2 + MESHES * noise) / (len(steps) + MESHES))


def plain_distances(sample: Floats, inverse: Floats) -> Floats:
    steps = sample[:, None] - sample
    squares = ((steps @ inverse) * steps).sum(axis=2)
    return SCALE * np.sqrt(np.maximum(squares, 0.0) / SPECTRUM)


def plain_metric(sample: Floats, count: int) -> tuple[Floats, float]:
    """Distances by the metric of `count` neighbours, and the relative distance of these."""
    off_diagonal = ~np.eye(len(sample), dtype=bool)
    coordinates = eigenvalue_coordinates(sample)
    distances = np.abs(coordinates[:, None] - coordinates).sum(axis=2)
    for _ in range(ROUNDS):
        nearest = (distances + 9.0 * ~off_diagonal).argsort(axis=1)[:, :count]
        pairs = [(i, j) for i, row in enumerate(nearest.tolist()) for j in row]
        distances = plain_distances(sample, inverse_covariance(sample, pairs))
    folds: list[list[tuple[int, int]]] = [[] for _ in range(FOLDS)]
    for i, j in pairs:
        folds[int(MIXING * np.abs(sample[i] - sample[j]).sum()) % FOLDS].append((i, j))
    ratios: list[float] = []
    for held in folds:
        others = [pair for fold in folds if fold is not held for pair in fold]
        measured = plain_distances(sample, inverse_covariance(sample, others))
        ratios += [measured[pair] / np.median(measured[off_diagonal]) for pair in held]
    return distances, float(np.median(ratios))


def test_the_metric_is_the_inverse_of_the_covariance_of_as_many_poses_as_there_are() -> None:
    for poses in (2, 3, 4, 6):
        sample = posed_bodies(1, bodies=24, poses=poses)
        metrics = [plain_metric(sample, count) for count in range(1, NEIGHBOURS + 1)]
        relative = np.array([each for _, each in metrics])
        rising = relative > RISE * np.minimum.accumulate(relative)
        assert relative[0] < RELATIVE_DISTANCE
        assert rising.tolist() == [count >= poses for count in range(1, NEIGHBOURS + 1)]
        plain = metrics[min(poses - 1, NEIGHBOURS) - 1][0]
        assert all_distances(sample, sample) == pytest.approx(plain, rel=1e-4, abs=1e-6)


def test_individuals_with_one_pose_each_make_no_kind_however_often_they_are_stored() -> None:
    rng = np.random.default_rng(0)
    for seed in range(3):
        sample = posed_bodies(seed, bodies=24, poses=1)
        for stored in (sample, np.repeat(sample, 2, axis=0), rng.permutation(np.concatenate([sample] * 4))):
            assert not len(kinds_of(stored).factors)


def test_bodies_have_a_metric_beside_individuals_that_have_none() -> None:
    individuals, bodies = posed_bodies(0, centre=-1.0, bodies=24, poses=1), posed_bodies(0)
    kinds = kinds_of(np.concatenate([individuals, bodies]))
    assert kinds.of(individuals).kinds.tolist() == [NO_KIND] * len(individuals)
    assert kinds.of(bodies).kinds.tolist() == [0] * len(bodies)
    assert kinds.factors == pytest.approx(kinds_of(bodies).factors, rel=1e-4, abs=1e-6)


def test_bodies_that_are_stored_as_two_meshes_keep_their_metric() -> None:
    sample = posed_bodies(0)
    remeshed = sample + 0.5 * MESH_NOISE * np.random.default_rng(0).normal(size=sample.shape)
    views = np.random.default_rng(1).integers(256, size=(len(sample), VIEW_BYTES), dtype=np.uint8)
    kinds = kinds_in(np.concatenate([sample, remeshed]), np.concatenate([views, views]))
    assert kinds.of(sample).kinds.tolist() == [0] * len(sample)


def test_each_metric_finds_better_poses_for_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    sample = posed_bodies(7)
    last = first_tier(all_distances(sample, sample))
    monkeypatch.setattr("core.ranking.kinds.ROUNDS", 1)
    assert first_tier(all_distances(sample, sample)) < last - 0.02


def test_distances_do_not_depend_on_the_order_and_another_mesh_is_near() -> None:
    sample = posed_bodies(8)
    distances = all_distances(sample, sample)
    assert (distances == distances.T).all()
    assert all_distances(sample[::-1], sample) == pytest.approx(distances, rel=1e-4, abs=1e-6)
    kinds = kinds_of(sample)
    finer = kinds.of(sample[:1] + 0.01 * TREND)
    assert finer.distances(kinds.of(sample[:1]))[0] < 0.02 * distances[0, POSES]


def test_shapes_of_two_kinds_of_none_or_without_eigenvalues_have_no_distance() -> None:
    first, second = posed_bodies(3), posed_bodies(4, centre=1.0)
    lacking = np.full((1, SPECTRUM), np.nan)
    sample = np.concatenate([first, lacking, second, first[:2] + 5.0])
    kinds = kinds_of(sample).of(sample).kinds.tolist()
    assert kinds == [0] * len(first) + [NO_KIND] + [1] * len(second) + [NO_KIND] * 2
    distances = all_distances(sample, sample)
    assert np.isfinite(distances).sum() == 2 * len(first) ** 2
    assert all_distances(sample, first) == pytest.approx(all_distances(first, first))


def test_copies_and_few_poses_make_no_kind() -> None:
    sample = posed_bodies(5)
    for few in (sample[:0], sample[:4], np.repeat(sample[:1], 9, axis=0)):
        assert kinds_of(few).of(sample).kinds.tolist() == [NO_KIND] * len(sample)
    copies = np.concatenate([sample, sample, sample + 1e-3 * COPY])
    assert first_tier(all_distances(copies, sample)) > 0.8


def test_sizes_of_a_part_that_mostly_look_alike_make_no_kind() -> None:
    sample = posed_bodies(6)
    alike = np.zeros((len(sample), VIEW_BYTES), dtype=np.uint8)
    assert kinds_in(sample, alike).of(sample).kinds.tolist() == [NO_KIND] * len(sample)
    # A few sizes of a bracket look different: a leg is longer.
    alike[: POSES + 1] = np.random.default_rng(0).integers(256, size=(POSES + 1, VIEW_BYTES))
    assert kinds_in(sample, alike).of(sample).kinds.tolist() == [NO_KIND] * len(sample)
    assert kinds_of(sample).of(sample).kinds.tolist() == [0] * len(sample)


def test_nobody_has_a_distance_without_a_sample() -> None:
    assert np.isinf(without_kinds(1).distances(without_kinds(3))).tolist() == [True] * 3
