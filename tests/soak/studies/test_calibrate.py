"""`isoshape calibrate` with every amount of every kind of change, and again."""

from pathlib import Path

from tests.service.cli.conftest import Run
from tests.service.cli.studies.test_calibrate import second

__all__ = ["second"]


def test_the_page_is_the_same_again(collection: Path, second: Path, run: Run, tmp_path: Path) -> None:
    asked = ("calibrate", collection, second, "--parts", 9)
    first = run(*asked, "--out", tmp_path / "first")
    again = run(*asked, "--out", tmp_path / "again")
    assert (first.status, again.status) == (0, 0)
    assert "CALIBRATED_POOL = Calibration(" in again.stdout
    for name in ("calibration.md", "calibration.png"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "first" / name).read_bytes()
