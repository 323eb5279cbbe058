"""Maps of shapes: distances on a plane stay, groups stay together, cells are apart."""

from itertools import permutations, product

import numpy as np
import pytest

from core.ranking.similarity_map import grid_cells, principal_positions, similarity_map


def distances(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, None] - points[None], axis=2)


def test_signatures_on_a_plane_keep_their_distances() -> None:
    rng = np.random.default_rng(1)
    plane = np.linalg.qr(rng.normal(size=(30, 2)))[0]
    points = rng.normal(size=(40, 2)) * [3, 1]
    signatures = (points @ plane.T + 5.0).astype(np.float32)
    positions = principal_positions(signatures)
    assert distances(positions) == pytest.approx(distances(points), abs=1e-5)
    assert positions[np.abs(positions).argmax(axis=0), [0, 1]].min() > 0


def test_groups_stay_together() -> None:
    rng = np.random.default_rng(0)
    labels = np.repeat(np.arange(3), 30)
    signatures = 10 * np.eye(3, 30)[labels] + rng.normal(size=(90, 30))
    positions = similarity_map(signatures.astype(np.float32)).positions
    apart = distances(positions)
    np.fill_diagonal(apart, np.inf)
    assert (labels[np.argsort(apart, axis=1)[:, :5]] == labels[:, None]).mean() > 0.9


@pytest.mark.parametrize("count", [0, 1, 2, 7, 16, 60])
def test_positions_are_in_the_unit_square_and_cells_are_apart(count: int) -> None:
    signatures = np.random.default_rng(count).normal(size=(count, 5)).astype(np.float32)
    # Equal shapes have a map too.
    for laid_out in (similarity_map(signatures), similarity_map(np.zeros_like(signatures))):
        assert laid_out.positions.shape == laid_out.cells.shape == (count, 2)
        assert ((laid_out.positions >= 0) & (laid_out.positions <= 1)).all()
        assert len({tuple(cell) for cell in laid_out.cells.tolist()}) == count
        assert ((laid_out.cells >= 0) & (laid_out.cells < max(laid_out.size, 1))).all()


def test_cells_are_the_nearest_of_all_arrangements() -> None:
    positions = np.array([[0.9, 0.2], [0.1, 0.7], [0.2, 0.1], [0.8, 0.3], [0.95, 0.0]])
    cells, size = grid_cells(positions)
    assert size == 3
    every = (np.array(list(product(range(3), repeat=2))) + 0.5) / 3.0
    least = min(((every[list(some)] - positions) ** 2).sum() for some in permutations(range(9), 5))
    assert (((cells + 0.5) / 3.0 - positions) ** 2).sum() == pytest.approx(least)
