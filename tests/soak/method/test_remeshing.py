"""A shape of any class that is meshed anew finds itself first among the poses of its class."""

import pytest

from core.gallery import CLASSES
from tests.core.test_remeshing import assert_found_when_remeshed


@pytest.mark.parametrize("label", CLASSES)
def test_four_faces_for_each_or_half_of_them_find_the_original(label):
    assert_found_when_remeshed(label)
