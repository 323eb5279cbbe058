"""The reliability of intrinsic descriptions, on surfaces whose faults are counted by hand."""

from dataclasses import replace

import pytest

from core.descriptors.facts import intrinsic_reliability
from core.gallery import make_shape
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from tests.studies.perturbation import make_soup

FACTS = Pipeline(DEFAULT).embed(make_shape("cup", 0)).facts


def test_a_closed_manifold_surface_of_one_piece_is_reliable() -> None:
    assert intrinsic_reliability(FACTS) == 1.0


@pytest.mark.parametrize(
    ("faults", "expected"),
    [
        ({"boundary_edges": 3}, 1.0 / 2.0),
        ({"nonmanifold_edges": 3}, 1.0 / 2.0),
        ({"components": 3}, 1.0 / 2.0),
        ({"boundary_edges": 6, "nonmanifold_edges": 3, "components": 5}, 1.0 / 6.0),
    ],
)
def test_each_fault_lowers_it(faults: dict[str, int], expected: float) -> None:
    """100 faces have 150 edges; 3 of them are 2 %."""
    assert intrinsic_reliability(replace(FACTS, faces=100, dropped_faces=0, **faults)) == pytest.approx(
        expected
    )


def test_a_polygon_soup_is_hardly_reliable() -> None:
    soup = Pipeline(DEFAULT).embed(make_soup(make_shape("cup", 0), 0.1, 0))
    assert intrinsic_reliability(soup.facts) < 0.05
