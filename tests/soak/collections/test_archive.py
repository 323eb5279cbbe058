"""The whole path on a real collection: serve, ingest, and a query a class, over HTTP."""

import subprocess
import sys
from pathlib import Path

import pytest

from service.client import Client
from service.datasets import read_collection
from tests.service.processes import server
from tests.soak.collections.folders import SAMPLE, sample


def test_every_mesh_is_stored_with_its_class_and_finds_itself(tmp_path: Path) -> None:
    folder = tmp_path / "psb"
    for path, label in sample("psb"):
        (folder / label).mkdir(exist_ok=True, parents=True)
        (folder / label / path.name).symlink_to(path)
    labels = dict(read_collection(folder))
    with server(tmp_path, ISOSHAPE_WORKERS="2") as (_, http), Client(str(http.base_url)) as client:
        command = [sys.executable, "-m", "service.cli", "ingest", str(folder), "--url", str(http.base_url)]
        ingested = subprocess.run(command, capture_output=True, text=True, check=False)
        assert ingested.returncode == 0, ingested.stderr
        stored = {shape.name: shape.tags for shape in client.shapes()}
        assert stored == {path.name: [label] for path, label in labels.items()}
        assert len(stored) == (SAMPLE or 190)
        for label, path in {label: path for path, label in labels.items()}.items():
            first, *others = client.query_file(path).results
            assert (first.shape.name, first.shape.tags, len(others)) == (path.name, [label], 2)
            assert (first.cc, first.ssd, first.sim) == pytest.approx((1.0, 0.0, 1.0), abs=1e-6)
