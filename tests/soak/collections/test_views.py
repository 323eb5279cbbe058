"""Retrieval by the view descriptor alone on a real collection."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.collections

MEASURED = {"nn": 0.703, "ft": 0.449, "st": 0.574}


def test_views_are_as_good_as_measured_on_web_models() -> None:
    if "ISOSHAPE_DATA" not in os.environ:
        pytest.skip("ISOSHAPE_DATA does not name a folder of collections")
    folder = Path(os.environ["ISOSHAPE_DATA"]) / "webmodels"
    command = [sys.executable, "-m", "service.cli", "evaluate", str(folder), "--method", "views", "--json"]
    report = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert {key: report[key] for key in MEASURED} == pytest.approx(MEASURED, abs=0.005)
