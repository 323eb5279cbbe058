"""The true correspondence of individuals of one class."""

import numpy as np
import pytest

from core.errors import ParameterError
from core.evaluation.correspondence_errors import surface_distances
from core.gallery.bodies import individual_partners, make_body


def test_a_body_is_its_own_partner():
    body = make_body("teddy", 1, vertices=700)
    np.testing.assert_array_equal(individual_partners(body, body), body.partners(body))


@pytest.mark.parametrize("label", ["person", "quadruped", "teddy", "bird"])
def test_there_and_back_between_individuals(label):
    one, other = (make_body(label, number, vertices=900) for number in (0, 1))
    there, back = individual_partners(one, other)[0], individual_partners(other, one)[0]
    around = surface_distances(one)[back[there], np.arange(len(there))]
    assert around.mean() < 0.03
    # The vertices of the left are on the left.
    across = one.rest.vertices[:, 1]
    sides = other.rest.vertices[there, 1][np.abs(across) > 0.1 * np.abs(across).max()]
    assert (np.sign(sides) == np.sign(across[np.abs(across) > 0.1 * np.abs(across).max()])).mean() > 0.99


def test_other_classes_have_other_solids():
    with pytest.raises(ParameterError):
        individual_partners(make_body("cup", vertices=500), make_body("fish", vertices=500))
