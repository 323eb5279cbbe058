"""The study of differences keeps its bounds, with dimensions that it has not been made with."""

from pathlib import Path

import pytest

from tests.studies.differences import main

pytestmark = pytest.mark.studies


def test_differences_have_their_closed_forms_and_copies_have_none(tmp_path: Path) -> None:
    assert main(tmp_path, seed=3)
