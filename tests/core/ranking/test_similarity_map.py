"""Maps of shapes: groups stay together, cells are apart, equal shapes give equal maps."""

import numpy as np
import pytest

from core.ranking.similarity_map import classical_scaling, in_cells, similarity_map


def distances(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, None] - points[None], axis=2)


def grouped(groups: int, each: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points of some groups in eight dimensions, and their groups."""
    rng = np.random.default_rng(seed)
    labels = np.repeat(np.arange(groups), each)
    return 10 * rng.normal(size=(groups, 8))[labels] + rng.normal(size=(len(labels), 8)), labels


def test_classical_scaling_finds_positions_on_a_plane() -> None:
    points = np.random.default_rng(1).normal(size=(40, 2)) * [3, 1]
    found = classical_scaling(distances(points))
    assert distances(found) == pytest.approx(distances(points), abs=1e-9)
    assert found[np.abs(found).argmax(axis=0), [0, 1]].min() > 0


def test_groups_stay_together() -> None:
    points, labels = grouped(8, 30)
    found = similarity_map(distances(points))
    for places in (found.positions, found.cells.astype(float)):
        apart = distances(places)
        np.fill_diagonal(apart, np.inf)
        nearest = np.argsort(apart, axis=1)[:, :5]
        assert (labels[nearest] == labels[:, None]).mean() > 0.9


@pytest.mark.parametrize("count", [0, 1, 2, 7, 15, 16, 60])
def test_positions_are_in_the_unit_square_and_cells_are_apart(count: int) -> None:
    points = np.random.default_rng(count).normal(size=(count, 5))
    found = similarity_map(distances(points))
    assert found.positions.shape == found.cells.shape == (count, 2)
    assert ((found.positions >= 0) & (found.positions <= 1)).all()
    assert len({tuple(cell) for cell in found.cells.tolist()}) == count
    assert ((found.cells >= 0) & (found.cells < max(found.size, 1))).all()
    again = similarity_map(distances(points))
    assert np.array_equal(found.positions, again.positions)
    assert np.array_equal(found.cells, again.cells)


@pytest.mark.parametrize("count", [12, 20])
def test_equal_shapes_have_a_map_too(count: int) -> None:
    found = similarity_map(np.zeros((count, count)))
    assert np.isfinite(found.positions).all()
    assert len({tuple(cell) for cell in found.cells.tolist()}) == count


def test_cells_are_the_nearest_ones_that_are_free() -> None:
    positions = np.array([[0.1, 0.1], [0.12, 0.1], [0.9, 0.9]])
    cells = in_cells(positions, 4)
    assert cells[2].tolist() == [3, 3]
    assert sorted(cells[:2].tolist()) == [[0, 0], [1, 0]]
    # The one further to the right goes to the right.
    assert cells[1].tolist() == [1, 0]
