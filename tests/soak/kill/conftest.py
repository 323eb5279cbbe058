"""The library that makes the disk fail beneath a process."""

import os
import subprocess
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def preloaded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment in which `faults.c` is preloaded, without settings of the tester's own."""
    library = tmp_path_factory.mktemp("faults") / "faults.so"
    source = Path(__file__).with_name("faults.c")
    options = ["-shared", "-fPIC", "-O2", "-Wall", "-Wextra", "-Werror"]
    subprocess.run(["cc", *options, "-o", str(library), str(source)], check=True)
    inherited = {key: value for key, value in os.environ.items() if not key.startswith("ISOSHAPE_")}
    # Sets of words have the same order in each run.
    return {**inherited, "LD_PRELOAD": str(library), "PYTHONHASHSEED": "0"}
