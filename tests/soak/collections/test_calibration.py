"""The constants of `combined` are those that its command fits to the collections, and they are calibrated.

With SAMPLE=64 the command has 64 shapes of each collection, and its models have other constants: only their
errors are judged.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from core.ranking.opinion_pool import CALIBRATED_PARTS, CALIBRATED_POOL

COLLECTIONS = {"psb": 190, "shrec11": 300, "webmodels": 495}
"""Number of shapes of each collection."""

LARGEST_ERROR, OF_SAMPLES, OF_FEW_PARTS = 0.01, 0.02, 0.06
"""Largest expected calibration errors by models fitted to whole collections, to samples of them, and to the
incomplete shapes made from a fifth of the samples."""


@pytest.mark.collections
def test_the_constants_are_those_of_the_command_and_calibrated() -> None:
    """Classes are judged by models that have not seen them."""
    if "ISOSHAPE_DATA" not in os.environ:
        pytest.skip("ISOSHAPE_DATA does not name a folder of collections")
    folders = [str(Path(os.environ["ISOSHAPE_DATA"]) / name) for name in COLLECTIONS]
    sample = os.environ.get("SAMPLE", "")
    options = ["--limit", sample, "--parts", str(int(sample) // 5)] if sample else []
    command = [sys.executable, "-m", "service.cli", "calibrate", *folders, *options, "--json"]
    found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    sizes = [int(sample)] * len(COLLECTIONS) if sample else list(COLLECTIONS.values())
    assert [one["shapes"] for one in found["collections"]] == sizes
    if not sample:
        for fitted, written in ((found, CALIBRATED_POOL), (found["incomplete"], CALIBRATED_PARTS)):
            assert fitted["intercept"] == pytest.approx(written.intercept, abs=0.01)
            assert fitted["slopes"] == pytest.approx(written.slopes, abs=0.01)
    for one in (found["together"], *found["collections"]):
        assert one["error"] < (OF_SAMPLES if sample else LARGEST_ERROR)
    assert found["incomplete"]["error"] < (OF_FEW_PARTS if sample else LARGEST_ERROR)
