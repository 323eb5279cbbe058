"""Retrieval on real collections, and the calibration of `combined`, by the commands that measure them."""

import json
import subprocess
import sys

import pytest

from core.ranking.class_probability import (
    CALIBRATED_PARTS,
    CALIBRATED_PLAIN_PARTS,
    CALIBRATED_PLAIN_POOL,
    CALIBRATED_POOL,
)
from tests.soak.collections.folders import SAMPLE, data

LEAST = {"nn": 0.895, "ft": 0.709, "st": 0.81}
"""Least measures of psb by CC: measured ones less 0.01."""
VIEWS = {"nn": 0.703, "ft": 0.449, "st": 0.574}
"""Measures of webmodels by the view descriptor alone."""

CALIBRATED = {"psb": 190, "shrec11": 300, "webmodels": 495}
"""Number of shapes of each collection that calibrates."""
FITTED = 64
"""Number of shapes of each collection in a sample: by half as many the errors are three times as large."""
LARGEST_ERROR, OF_SAMPLES, OF_FEW_PARTS = 0.01, 0.02, 0.06
"""Largest expected calibration errors by models fitted to whole collections, to samples of them, and to the
incomplete shapes made from a fifth of the samples."""


def report(*arguments: str) -> dict:
    """Return the report of a command."""
    command = [sys.executable, "-m", "service.cli", *arguments, "--json"]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def test_retrieval_is_as_good_as_measured() -> None:
    measured = report("evaluate", str(data() / "psb"))
    assert (measured["shapes"], measured["classes"]) == (190, 19)
    for measure, least in LEAST.items():
        assert measured[measure] > least, (measure, measured[measure])


def test_views_are_as_good_as_measured_on_web_models() -> None:
    measured = report("evaluate", str(data() / "webmodels"), "--method", "views")
    assert {key: measured[key] for key in VIEWS} == pytest.approx(VIEWS, abs=0.005)


def test_the_constants_are_those_of_the_command_and_calibrated() -> None:
    """Classes are judged by models that have not seen them. A sample gives other constants."""
    options = ["--limit", str(FITTED), "--parts", str(FITTED // 5)] if SAMPLE else []
    fitted = report("calibrate", *(str(data() / name) for name in CALIBRATED), *options)
    sizes = [collection["shapes"] for collection in fitted["collections"]]
    assert sizes == ([FITTED] * len(CALIBRATED) if SAMPLE else list(CALIBRATED.values()))
    if not SAMPLE:
        for model, written in (
            (fitted, CALIBRATED_POOL),
            (fitted["incomplete"], CALIBRATED_PARTS),
            (fitted["plain"], CALIBRATED_PLAIN_POOL),
            (fitted["plain_incomplete"], CALIBRATED_PLAIN_PARTS),
        ):
            assert model["intercept"] == pytest.approx(written.intercept, abs=0.01)
            assert model["slopes"] == pytest.approx(written.slopes, abs=0.01)
    for collection in (fitted["together"], *fitted["collections"]):
        assert collection["error"] < (OF_SAMPLES if SAMPLE else LARGEST_ERROR)
    assert fitted["incomplete"]["error"] < (OF_FEW_PARTS if SAMPLE else LARGEST_ERROR)
