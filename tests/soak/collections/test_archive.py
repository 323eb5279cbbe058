"""The whole path on a real collection: serve, ingest, and a query a class, over HTTP."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.client import Client
from service.datasets import read_collection
from service.server.process import LOOPBACK, ChildService, bind, wait_until_ready
from tests.soak.collections.folders import SAMPLE, sample

pytestmark = pytest.mark.collections


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with links to the files of psb, a folder for each class."""
    folder = tmp_path_factory.mktemp("psb")
    for path, label in sample("psb"):
        (folder / label).mkdir(exist_ok=True)
        (folder / label / path.name).symlink_to(path)
    return folder


@pytest.fixture(scope="module")
def archive(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    """Yield the client of a service into which `isoshape ingest` has put the collection."""
    database = tmp_path_factory.mktemp("archive") / "archive.sqlite3"
    listener = bind(LOOPBACK, 0)
    port = listener.getsockname()[1]
    listener.close()
    settings = {"ISOSHAPE_DATABASE_URL": f"sqlite:///{database}", "ISOSHAPE_LOG_LEVEL": "error"}
    with ChildService(port, settings) as child, Client(child.url) as client:
        wait_until_ready(client, child.ended)
        command = [sys.executable, "-m", "service.cli", "ingest", str(folder), "--url", child.url]
        ingested = subprocess.run(command, capture_output=True, text=True, check=False)
        assert ingested.returncode == 0, ingested.stderr
        yield client


def test_every_mesh_is_stored_with_its_class(archive: Client, folder: Path) -> None:
    stored = {shape.name: shape.tags for shape in archive.shapes()}
    files = {path.name: [label] for path, label in read_collection(folder)}
    assert len(files) == (SAMPLE or 190)
    assert stored == files


def test_a_query_a_class_finds_the_shape_itself(archive: Client, folder: Path) -> None:
    for label, path in {label: path for path, label in read_collection(folder)}.items():
        first, *others = archive.query_file(path).results
        assert first.shape.name == path.name
        assert first.shape.tags == [label]
        assert first.cc == pytest.approx(1.0, abs=1e-6)
        assert first.ssd == pytest.approx(0.0, abs=1e-6)
        assert first.sim == pytest.approx(1.0, abs=1e-6)
        assert len(others) == 2
