"""The constants of `combined` are what its command fits to the collections, and they are calibrated."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from core.ranking.class_probability import CALIBRATED, CALIBRATED_PARTS, WITHOUT_SPIN_IMAGES

pytestmark = pytest.mark.collections

LARGEST_ERROR = 0.05


def test_the_constants_are_those_of_the_command_and_calibrated() -> None:
    if "ISOSHAPE_DATA" not in os.environ:
        pytest.skip("ISOSHAPE_DATA does not name a folder of collections")
    folders = [str(Path(os.environ["ISOSHAPE_DATA"]) / name) for name in ("psb", "shrec11")]
    command = [sys.executable, "-m", "service.cli", "calibrate", *folders, "--json"]
    found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert [one["shapes"] for one in found["collections"]] == [190, 300]
    models = (found, CALIBRATED), (found["incomplete"], CALIBRATED_PARTS)
    for fitted, written in (*models, (found["without_patches"], WITHOUT_SPIN_IMAGES)):
        assert fitted["intercept"] == pytest.approx(written.intercept, abs=0.01)
        assert fitted["slopes"] == pytest.approx(written.slopes, abs=0.01)
    for one in (found["together"], found["incomplete"], *found["collections"]):
        assert one["error"] < LARGEST_ERROR
