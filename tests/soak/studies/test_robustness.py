"""`isoshape robustness` with every kind of change."""

from pathlib import Path

import pytest

from core.studies.robustness import KINDS
from tests.service.cli.conftest import Run
from tests.service.cli.studies.test_robustness import assert_page_of, study_of


def test_every_kind_the_page_and_the_pictures(
    collection: Path, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study_of(monkeypatch, KINDS)
    monkeypatch.setattr("service.cli.studies.robustness.TAUS", (0.2,))
    assert_page_of(KINDS, ["1", "40", "40", "10", "100", "5", "2"], collection, run, tmp_path)
