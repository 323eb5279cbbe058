"""Damaged surfaces are embedded and compared without a fault of arithmetic, or refused by name."""

from functools import cache

import numpy as np
import pytest

from core import sparse_embedding
from core.errors import CannotBeEmbeddedError, DegenerateMeshError
from core.mesh import ordering
from core.numerics.guarding import check_finite, guarded
from core.parameters import DEFAULT, PAPER
from core.pipeline import Pipeline
from core.spectral.spectral_embedding import spectra_of
from tests.core.damaged import DAMAGES, touching_boxes
from tests.core.shapes import blob, box, loose_parts
from tests.gallery import make_shape

SOUND = {
    "blob": lambda: blob(0, 2),
    "loose parts": loose_parts,
    "touching boxes": lambda: touching_boxes(30),
    "hand": lambda: make_shape("hand", 0),
}


@cache
def sound(shape):
    """A surface, and its embedding."""
    mesh = SOUND[shape]()
    return mesh, Pipeline(DEFAULT).embed(mesh)


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("shape", SOUND)
def test_a_damaged_surface_is_embedded_and_compared(shape, damage):
    pipeline = Pipeline(DEFAULT)
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        mesh, one = sound(shape)
        other = pipeline.embed(DAMAGES[damage](mesh, np.random.default_rng(0)))
        match = pipeline.match(one, other)
    assert np.isfinite([match.cc, match.ssd, match.sim]).all()


@pytest.mark.parametrize("damage", ["component_doubled", "vertices_on_a_grid", "coplanar_sheets"])
def test_the_papers_method_does_so_too(damage):
    mesh = blob(0, 2)
    pipeline = Pipeline(PAPER)
    one, other = pipeline.embed(mesh), pipeline.embed(DAMAGES[damage](mesh, np.random.default_rng(0)))
    assert np.isfinite(pipeline.score(one, [one, other]).cc).all()


@pytest.mark.parametrize("rounds", [1, 2, 3, 40])
def test_the_last_round_of_refinement_may_separate_all_vertices(monkeypatch, rounds):
    """Vertices on a sphere are equally far from its centre, and the lengths of edges tell them apart."""
    points = np.random.default_rng(1).normal(size=(60, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    faces = np.array([[i, (i + 1) % 60, (i + 7) % 60] for i in range(60)])
    monkeypatch.setattr(ordering, "ROUNDS", rounds)
    order = ordering.canonical_order(points, faces, np.zeros(3))
    assert sorted(order) == list(range(60))


EXPECTED = [DegenerateMeshError("flat"), MemoryError(), KeyboardInterrupt()]
UNEXPECTED = [ValueError("argmax"), FloatingPointError(), IndexError(), ZeroDivisionError()]


@pytest.mark.parametrize("error", EXPECTED + UNEXPECTED)
def test_expected_errors_keep_their_names_and_others_say_that_the_mesh_cannot_be_embedded(monkeypatch, error):
    def fail(*_arguments, **_named):
        raise error

    monkeypatch.setattr(sparse_embedding, "embedded_points", fail)
    with pytest.raises(type(error) if error in EXPECTED else CannotBeEmbeddedError) as caught:
        Pipeline(DEFAULT).embed(box(1, 1, 1))
    assert (caught.value if error in EXPECTED else caught.value.__cause__) is error


@pytest.mark.parametrize("parameters", [DEFAULT, PAPER])
def test_no_coordinate_that_is_not_finite_is_rounded(monkeypatch, parameters):
    def spoilt(*arguments):
        spectra, *others = spectra_of(*arguments)
        spectra[0].coordinates[-1, 0] = np.nan
        return spectra, *others

    monkeypatch.setattr(sparse_embedding, "spectra_of", spoilt)
    with pytest.raises(CannotBeEmbeddedError) as caught:
        Pipeline(parameters).embed(blob(0, 2), ())
    assert "not finite" in str(caught.value.__cause__) or "invalid value" in str(caught.value.__cause__)


@pytest.mark.parametrize(
    "operation",
    [
        lambda: np.log(np.zeros(1)),
        lambda: np.full(1, 1e300) ** 2,
        lambda: np.sqrt(-np.ones(1)),
        lambda: check_finite([np.nan]),
    ],
)
def test_no_fault_of_arithmetic_passes(operation):
    with pytest.raises(CannotBeEmbeddedError), guarded():
        operation()
