"""Retrieval on a real collection, against what a first prototype reached there by CC."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.collections

PROTOTYPE = {"nn": 0.82, "ft": 0.58, "st": 0.70}


def test_default_is_better_than_the_prototype() -> None:
    if "ISOSHAPE_DATA" not in os.environ:
        pytest.skip("ISOSHAPE_DATA does not name a folder of collections")
    psb = Path(os.environ["ISOSHAPE_DATA"]) / "psb"
    command = [sys.executable, "-m", "service.cli", "evaluate", str(psb), "--json"]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    report = json.loads(told)
    assert report["shapes"] == 190
    assert report["classes"] == 19
    for measure, figure in PROTOTYPE.items():
        assert report[measure] > figure, (measure, report[measure])
