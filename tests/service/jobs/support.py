"""Archives made for the tests, honest ones and others, and jobs over HTTP."""

import io
import json
import stat
import zipfile
from collections.abc import Mapping, Sequence
from typing import Any

import httpx

from tests.service.support import Running, small_file, wait_until


def pack(files: Mapping[str, bytes] | Sequence[tuple[str, bytes]]) -> bytes:
    """Return a zip of files by their names, of which some may be there twice."""
    pairs = list(files.items()) if isinstance(files, Mapping) else list(files)
    return zipped([(zipfile.ZipInfo(name), data) for name, data in pairs])


def zipped(members: Sequence[tuple[zipfile.ZipInfo, bytes]]) -> bytes:
    """Return a zip of members with their headers; deflated, unless a header says otherwise."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for info, data in members:
            archive.writestr(info, data, info.compress_type or zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def zip_link(name: str) -> zipfile.ZipInfo:
    """Return the header of a symbolic link."""
    info = zipfile.ZipInfo(name)
    info.create_system = 3
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    return info


def send(client: httpx.Client, archive: bytes, name: str = "meshes.zip", **fields: Any) -> httpx.Response:
    """POST /jobs with an archive and text fields."""
    return client.post("/jobs", files={"file": (name, archive)}, data=fields)


def begun(client: httpx.Client, archive: bytes, **fields: Any) -> str:
    """The id of a job that was acknowledged."""
    answer = send(client, archive, **fields)
    assert answer.status_code == 202, answer.text
    assert answer.headers["location"] == f"/jobs/{answer.json()['id']}"
    return str(answer.json()["id"])


def job(client: httpx.Client, job_id: str) -> dict[str, Any]:
    answer = client.get(f"/jobs/{job_id}")
    assert answer.status_code == 200, answer.text
    return dict(answer.json())


def ended(client: httpx.Client, job_id: str, seconds: float = 300) -> dict[str, Any]:
    """The job, when it has ended."""
    wait_until(lambda: job(client, job_id)["ended_at"], seconds=seconds)
    return job(client, job_id)


def has_stored(client: httpx.Client, job_id: str, many: int) -> bool:
    """Whether a job has stored so many shapes."""
    return bool(job(client, job_id)["counts"]["stored"] >= many)


def files(client: httpx.Client, job_id: str, **query: Any) -> list[dict[str, Any]]:
    """All files of a job, page by page."""
    found: list[dict[str, Any]] = []
    while True:
        page = client.get(f"/jobs/{job_id}/files", params={"limit": 7, **query}).json()
        found += page["files"]
        if page["next_cursor"] is None:
            assert page["total"] == len(found)
            return found
        query["cursor"] = page["next_cursor"]


def causes(client: httpx.Client, job_id: str) -> dict[str, str]:
    """Why files were refused, by their paths."""
    return {
        file["path"]: file["problem"]["type"].rpartition(":")[2]
        for file in files(client, job_id, outcome="refused")
    }


def stored(running: Running) -> dict[str, bytes]:
    """The bytes of every shape, by its name; no name is there twice."""
    shapes = running.client.get("/shapes", params={"limit": 500}).json()["shapes"]
    found = {shape["name"]: running.client.get(f"/shapes/{shape['id']}/file").content for shape in shapes}
    assert len(found) == len(shapes)
    return found


def meshes(numbers: range) -> dict[str, bytes]:
    return {f"folder {number % 3}/{number}.off": small_file(number) for number in numbers}


def events(lines: Any) -> list[tuple[str, str, dict[str, Any]]]:
    """The id, name and data of each event of a stream of server-sent events."""
    found, event = [], {}
    for line in lines:
        if line:
            field, _, value = line.partition(": ")
            event[field] = value
        else:
            if "data" in event:
                found.append((event["id"], event["event"], json.loads(event["data"])))
            event = {}
    return found
