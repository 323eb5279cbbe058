"""A bulk job of a real collection, with broken files among the good ones, by services that are killed."""

import io
import shutil
import signal
import zipfile
from pathlib import Path

import httpx
import pytest

from service.storage.checking import check
from tests.service.jobs.support import begun, ended, files, has_stored
from tests.service.processes import server
from tests.service.support import wait_until
from tests.soak.collections.folders import SAMPLE, sample

pytestmark = pytest.mark.collections

# Two cores take about two minutes, and a busy machine longer.
SECONDS = 1800
Told = dict[str, tuple[str, str | None]]


@pytest.fixture(scope="module")
def collection() -> dict[str, bytes]:
    """The files of `psb` by class and name."""
    return {f"{label}/{path.name}": path.read_bytes() for path, label in sample("psb")}


@pytest.fixture(scope="module")
def broken(collection: dict[str, bytes]) -> dict[str, tuple[bytes, str]]:
    """Five broken files, each with why it is."""
    whole = next(iter(collection.values()))
    return {
        "broken/half.off": (whole[: len(whole) // 2], "malformed-mesh"),
        "broken/empty.off": (b"", "empty-file"),
        "broken/nan.off": (b"OFF\n3 1 0\n0 0 nan\n1 0 0\n0 1 0\n3 0 1 2\n", "non-finite-coordinates"),
        "broken/points.off": (b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "no-triangles"),
        "../outside.off": (whole, "member-name"),
    }


@pytest.fixture(scope="module")
def archive(collection: dict[str, bytes], broken: dict[str, tuple[bytes, str]]) -> bytes:
    """Return a zip of all, the broken files spread among the good ones."""
    names = list(collection)
    for place, name in enumerate(broken):
        names.insert((place + 1) * len(collection) // 6 + place, name)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as packed:
        for name in names:
            packed.writestr(name, collection[name] if name in collection else broken[name][0])
    return buffer.getvalue()


def told(client: httpx.Client, folder: Path, job_id: str, collection: dict[str, bytes]) -> Told:
    """The outcome of each file and its cause, after a look at whether all that is said to be stored is."""
    by_path: Told = {}
    shapes = client.get("/shapes", params={"limit": 500}).json()["shapes"]
    names = {shape["id"]: shape["name"] for shape in shapes}
    for file in files(client, job_id):
        cause = file["problem"] and file["problem"]["type"].rpartition(":")[2]
        by_path[file["path"]] = (file["outcome"], cause)
        if file["outcome"] == "stored":
            assert names.pop(file["shape_id"]) == Path(file["path"]).name
            assert client.get(f"/shapes/{file['shape_id']}/file").content == collection[file["path"]]
    assert names == {}
    assert check(folder / "archive.sqlite3", lock_seconds=10).faults == []
    return by_path


def test_all_are_stored_and_the_broken_ones_named_killed_or_not(
    tmp_path: Path, collection: dict[str, bytes], broken: dict[str, tuple[bytes, str]], archive: bytes
) -> None:
    truth: Told = dict.fromkeys(collection, ("stored", None))
    truth |= {path: ("refused", kind) for path, (_, kind) in broken.items()}
    good = SAMPLE or 190
    assert (len(truth), len(broken)) == (good + 5, 5)
    counts = {"files": good + 5, "waiting": 0, "stored": good, "present": 0, "refused": 5}
    at_once, killed = tmp_path / "at once", tmp_path / "killed"
    at_once.mkdir()
    with server(at_once) as (_, client):
        job_id = begun(client, archive)
        done = ended(client, job_id, SECONDS)
        assert done["state"] == "done"
        assert done["counts"] == counts
        assert told(client, at_once, job_id, collection) == truth
    shutil.rmtree(at_once)
    killed.mkdir()
    with server(killed) as (process, client):
        job_id = begun(client, archive)
        wait_until(lambda: has_stored(client, job_id, good // 3), seconds=SECONDS)
        process.send_signal(signal.SIGKILL)
        process.wait()
    with server(killed) as (_, client):
        done = ended(client, job_id, SECONDS)
        assert done["counts"] == counts
        assert told(client, killed, job_id, collection) == truth
