"""Pieces of a surface, with closed forms."""

import numpy as np

from core.descriptors.pieces import COUNT, MOST, RADII, SIZE, VOLUME, number_of_pieces, pieces
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from tests.core.shapes import box, joined, rectangle, shifted, turned


def pieces_of(mesh):
    cleaned = clean(mesh)
    return pieces(cleaned.mesh, cleaned.labels)


def row_of_box(*sides):
    """Square root of the area, cube root of the volume, and radii: each pair of faces is two rectangles."""
    a, b, c = sides
    area = 2 * (a * b + b * c + c * a)
    moments = []
    for one, two, three in ((a, b, c), (b, c, a), (c, a, b)):
        # The two faces across the side are flat; on the other four, coordinates are spread evenly.
        moments.append((2 * two * three * (one / 2) ** 2 + (area - 2 * two * three) * one**2 / 12) / area)
    return [area**0.5, (a * b * c) ** (1 / 3), *np.sqrt(sorted(moments))]


def test_a_box_has_the_lengths_of_a_box_wherever_it_lies():
    for mesh in (box(3, 2, 1), shifted(turned(box(3, 2, 1), 4), (5, 6, 7))):
        (row,) = pieces_of(mesh)
        np.testing.assert_allclose(row[:COUNT], row_of_box(3, 2, 1), rtol=1e-6)
        assert row[COUNT] == 1


def test_equal_pieces_are_one_kind_and_the_largest_comes_first():
    bricks = [shifted(turned(box(3, 2, 1), seed), (9 * seed, 0, 0)) for seed in range(5)]
    rods = [shifted(box(6, 1, 1), (0, 9 + 3 * place, 0)) for place in range(2)]
    rows = pieces_of(joined(*rods, *bricks))
    assert rows[:, COUNT].tolist() == [2, 5]
    assert number_of_pieces(rows) == 7
    np.testing.assert_allclose(rows[:, :COUNT], [row_of_box(6, 1, 1), row_of_box(3, 2, 1)], rtol=1e-6)


def test_an_open_piece_has_no_volume():
    (row,) = pieces_of(rectangle(2, 1, 4, 4))
    assert row[VOLUME] == 0.0
    assert row[RADII][0] < 1e-6 * row[SIZE]


def test_no_more_kinds_are_described_than_a_bound():
    bars = [shifted(box(1, 1, 1 + place / 50), (0, 3 * place, 0)) for place in range(MOST + 9)]
    rows = pieces_of(joined(*bars))
    assert len(rows) == MOST
    assert (np.diff(rows[:, SIZE]) < 0).all()


def test_sizes_near_the_limits_of_files_are_finite():
    for scale in (1e-25, 1e25):
        mesh = box(3, 2, 1)
        (row,) = pieces_of(Mesh(scale * mesh.vertices, mesh.faces))
        np.testing.assert_allclose(row[:COUNT] / scale, row_of_box(3, 2, 1), rtol=1e-6)
