"""The plugin that ``make collections-test`` runs under."""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COMMAND = [
    sys.executable,
    "-m",
    "pytest",
    "-c",
    os.devnull,
    "-p",
    "tests.soak.no_skips",
    "--continue-on-collection-errors",
]

TESTS = """
import pytest

@pytest.fixture
def data():
    pytest.skip()

def test_that_passes(): pass
@pytest.mark.skip
def test_skipped_by_its_mark(): pass
def test_skipped_by_its_fixture(data): pass
def test_skipped_by_itself(): pytest.skip()
"""
WHOLE_FILE = """
import pytest
pytest.skip("no data", allow_module_level=True)
"""


def test_every_kind_of_skip_is_a_failure(tmp_path):
    (tmp_path / "test_each.py").write_text(TESTS)
    (tmp_path / "test_file.py").write_text(WHOLE_FILE)
    environment = os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    run = subprocess.run(
        [*COMMAND, tmp_path], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    ends = {outcome: int(count) for count, outcome in re.findall(r"(\d+) (\w+)", run.stdout.splitlines()[-1])}
    assert run.returncode == 1, run.stdout
    assert ends["passed"] == 1, run.stdout
    assert ends["failed"] + ends["errors"] == 4, run.stdout
    assert "skipped" not in ends, run.stdout
