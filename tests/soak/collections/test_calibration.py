"""The constants of `combined` are those of docs/calibration.md, and calibrated for the collections."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from core.ranking.class_probability import Calibration
from core.ranking.opinion_pool import CALIBRATED_PARTS, CALIBRATED_POOL

PAGE = Path(__file__).parents[3] / "docs" / "calibration.md"

COLLECTIONS = ("psb", "shrec11", "webmodels")

LARGEST_ERROR = 0.03
"""Of a third of the shapes it is up to 0.023; of all, at most 0.006 (docs/calibration.md)."""


def test_the_page_has_the_constants() -> None:
    code = PAGE.read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    names: dict[str, object] = {"Calibration": Calibration}
    exec(code, names)
    assert names["CALIBRATED_POOL"] == CALIBRATED_POOL
    assert names["CALIBRATED_PARTS"] == CALIBRATED_PARTS


@pytest.mark.collections
def test_models_of_a_third_of_the_shapes_are_calibrated() -> None:
    """Classes are judged by models that have not seen them."""
    if "ISOSHAPE_DATA" not in os.environ:
        pytest.skip("ISOSHAPE_DATA does not name a folder of collections")
    folders = [str(Path(os.environ["ISOSHAPE_DATA"]) / name) for name in COLLECTIONS]
    options = ["--limit", "100", "--parts", "16", "--json"]
    command = [sys.executable, "-m", "service.cli", "calibrate", *folders, *options]
    found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert [one["shapes"] for one in found["collections"]] == [100, 100, 100]
    for one in (found["together"], found["incomplete"], *found["collections"]):
        assert one["error"] < LARGEST_ERROR
    assert found["slopes"][4] < -1.0
    assert found["incomplete"]["slopes"][0] < -1.0
