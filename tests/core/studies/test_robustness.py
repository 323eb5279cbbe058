"""What is tried on shapes, and NN from scores of which only the queries are perturbed."""

import numpy as np
import pytest

from core.gallery import make_shape
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.studies.ablation import values_of
from core.studies.robustness import (
    KINDS,
    TAU_CAP,
    TAU_VERTICES,
    TAUS,
    Level,
    Retrieval,
    nearest_neighbour,
    tau_parameters,
)
from tests.core.shapes import blob, box, subdivided

LABELS = ["a", "a", "b", "b"]
FINDS_ALL = np.array([[0.1, 0.9, 0.3, 0.2], [0.8, 0.1, 0.7, 0.6], [0.2, 0.3, 0.1, 0.9], [0.5, 0.4, 0.6, 0.1]])
EVERYWHERE = np.ones((4, 4), dtype=bool)


def test_rows_are_queries_and_the_diagonal_is_not_read():
    assert nearest_neighbour({"cc": FINDS_ALL, "combined": FINDS_ALL}, EVERYWHERE, LABELS) == Retrieval(
        1.0, 1.0
    )
    turned = FINDS_ALL.copy()
    turned[1] = [0.1, 0.99, 0.7, 0.6]
    assert nearest_neighbour({"cc": turned, "combined": FINDS_ALL}, EVERYWHERE, LABELS) == Retrieval(
        0.75, 1.0
    )
    assert nearest_neighbour({"cc": FINDS_ALL, "combined": turned}, EVERYWHERE, LABELS) == Retrieval(
        1.0, 0.75
    )


def test_a_shape_without_a_score_is_no_answer():
    scored = EVERYWHERE.copy()
    scored[3] = False
    assert nearest_neighbour({"cc": FINDS_ALL, "combined": FINDS_ALL}, scored, LABELS) == Retrieval(
        0.75, 0.75
    )
    # Without its fellow in the gallery the second query finds nothing of its class either.
    scored[1, 0] = False
    assert nearest_neighbour({"cc": FINDS_ALL, "combined": FINDS_ALL}, scored, LABELS) == Retrieval(0.5, 0.5)
    nothing = np.zeros((4, 4), dtype=bool)
    assert nearest_neighbour({"cc": FINDS_ALL, "combined": FINDS_ALL}, nothing, LABELS) == Retrieval(0.0, 0.0)


def test_parts_are_ranked_where_they_are_scored():
    scores = {"cc": FINDS_ALL, "combined": FINDS_ALL, "part": -FINDS_ALL}
    assert nearest_neighbour(scores, EVERYWHERE, LABELS) == Retrieval(1.0, 1.0, 0.0)


def test_mean_and_ends_over_the_seeds():
    runs = (Retrieval(0.5, 0.9), Retrieval(0.7, 1.0), Retrieval(0.9, 0.8))
    level = Level("noise", 0.01, runs, (0.9, 0.9, 0.9), (0, 0, 0))
    assert level.ends("cc") == pytest.approx((0.7, 0.5, 0.9))
    assert level.ends("combined") == pytest.approx((0.9, 0.8, 1.0))


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_amounts_are_certain_where_the_seed_changes_nothing(kind):
    for amount in kind.amounts:
        one, other = (kind.perturb(blob(), amount, seed) for seed in (1, 2))
        same = one.faces.tobytes() == other.faces.tobytes()
        same = same and one.vertices.tobytes() == other.vertices.tobytes()
        if kind.name == "subdivision" and amount in kind.certain:
            # The midpoints come in another order, which cleaning settles.
            same = sorted(map(tuple, one.vertices)) == sorted(map(tuple, other.vertices))
        assert same == (amount in kind.certain)


@pytest.mark.parametrize("mesh", [make_shape("person", 0), subdivided(box(3, 2, 1))], ids=["person", "box"])
@pytest.mark.parametrize("tau", [TAUS[0], TAUS[-1]])
def test_samples_are_the_share_tau_of_about_so_many_vertices(tau, mesh):
    parameters = tau_parameters(tau)
    pipeline = Pipeline(parameters)
    surface = pipeline.normalise(mesh).surface
    assert 0.5 * TAU_VERTICES <= len(surface.vertices) <= 1.5 * TAU_VERTICES
    wanted = min(TAU_CAP, round(tau * len(surface.vertices)))
    assert len(pipeline.embed(mesh).positions) == wanted
    changed = {"name", "samples", "tau", "sample_cap"}
    changed |= {"refine_vertices", "refine_simplified"}
    changed |= {"decimate_above", "decimate_to", "decimate_pieces_above"}
    values = values_of(parameters)
    for key, value in values_of(DEFAULT).items():
        assert values[key] == value or key in changed
