"""The changes of an archive that are killed, or meet faults, at each of their operations on the disk."""

import asyncio
import json
import random
import time
from collections.abc import Awaitable, Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import httpx
from typer.testing import CliRunner

from service.cli.commands import command_line
from service.storage.checking import check
from tests.service.jobs.support import pack
from tests.service.support import small_file

OLD, NEW, REPLACEMENT, FIRST, SECOND = (small_file(number) for number in range(5))
METADATA = json.dumps({"part": 7, "drawn": True})
# A form keeps less than this in memory.
LONG_TEXT = random.Random(0).randbytes(1_500_000)
ARCHIVE = pack({"first.off": FIRST, "broken.off": FIRST[:500], "notes.txt": LONG_TEXT, "second.off": SECOND})

MODELS = Path("models")
"""The folder of a source, in the working folder: a file that is a shape, two equal ones and a broken one."""
FILES = {"a.off": OLD, "b.off": SECOND, "inner/copy of b.off": SECOND, "inner/c.off": FIRST[:500]}

KEPT, DELETED = "kept.off", "deleted.off"
FIELDS = ("name", "tags", "metadata", "format", "bytes", "sha256", "embedded", "facts")

Answering = Callable[[httpx.AsyncClient], Awaitable[httpx.Response]]
State = dict[str, Any]


@dataclass(frozen=True)
class Change:
    """A request to a service, a command without a service or, with neither, the first start of a service.

    In the words of a command, `{}` is the folder of the archive.
    """

    name: str
    request: Answering | None = None
    command: tuple[str, ...] = ()

    @property
    def is_first(self) -> bool:
        """Whether it makes an archive, where the others change one."""
        return self.request is None and not self.command


async def _path_of(client: httpx.AsyncClient, name: str, listing: str = "/shapes") -> str:
    shapes = (await client.get(listing)).json()["shapes"]
    return "/shapes/" + next(str(shape["id"]) for shape in shapes if shape["name"] == name)


async def upload(client: httpx.AsyncClient, name: str = "new.off", data: bytes = NEW) -> httpx.Response:
    fields = {"tags": ["new", "small"], "metadata": METADATA}
    headers = {"Idempotency-Key": f'"{name}"'}
    return await client.post("/shapes", files={"file": (name, data)}, data=fields, headers=headers)


async def replace(client: httpx.AsyncClient) -> httpx.Response:
    return await client.put(
        f"{await _path_of(client, KEPT)}/file", files={"file": ("other.off", REPLACEMENT)}
    )


async def delete(client: httpx.AsyncClient) -> httpx.Response:
    return await client.delete(await _path_of(client, KEPT))


async def erase(client: httpx.AsyncClient) -> httpx.Response:
    return await client.delete(await _path_of(client, KEPT), params={"permanent": True})


async def restore(client: httpx.AsyncClient) -> httpx.Response:
    return await client.post(f"{await _path_of(client, DELETED, '/deleted')}/restore")


async def job(client: httpx.AsyncClient) -> httpx.Response:
    return await client.post("/jobs", files={"file": ("meshes.zip", ARCHIVE)}, data={"tags": ["job"]})


async def scan(client: httpx.AsyncClient) -> httpx.Response:
    return await client.post("/sources", json={"path": str(MODELS.resolve()), "name": "models"})


CHANGES = (
    Change("first start"),
    Change("upload", upload),
    Change("replacement", replace),
    Change("delete", delete),
    Change("permanent delete", erase),
    Change("restore", restore),
    Change("job", job),
    Change("scan", scan),
    Change("isoshape backup", command=("backup", "{}/backups/nightly.sqlite3", "--force")),
    Change("isoshape recover", command=("recover", "{}/backups/weekly.sqlite3", "--force")),
)


def run_command(words: tuple[str, ...], folder: Path) -> int:
    """Run a command in this process and return its status, or raise what is no message to the user."""
    environment = {"ISOSHAPE_DATABASE_URL": f"sqlite:///{folder}/archive.sqlite3"}
    done = CliRunner().invoke(command_line(), [word.format(folder) for word in words], env=environment)
    if not isinstance(done.exception, SystemExit | None):
        raise done.exception
    return done.exit_code


async def make_archive(client: httpx.AsyncClient, folder: Path) -> None:
    """Store a shape, make two backups, store a second shape and delete it."""
    (folder / "backups").mkdir()
    assert (await upload(client, KEPT, OLD)).status_code == 201
    for name in ("nightly", "weekly"):
        backup = ("backup", f"{{}}/backups/{name}.sqlite3")
        assert await asyncio.to_thread(run_command, backup, folder) == 0
    assert (await upload(client, DELETED, FIRST)).status_code == 201
    assert (await client.delete(await _path_of(client, DELETED))).status_code == 204


async def finished(client: httpx.AsyncClient, seconds: float) -> None:
    """Wait until no job and no scan is unfinished, but no longer than some seconds."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        jobs, sources = await client.get("/jobs"), await client.get("/sources")
        if (
            jobs.status_code == sources.status_code == 200
            and all(each["ended_at"] for each in jobs.json()["jobs"])
            and all(each["state"] in {"ready", "offline"} for each in sources.json()["sources"])
        ):
            return
        await asyncio.sleep(0.01)


async def state(client: httpx.AsyncClient, folder: Path, *, backups: bool = False) -> State:
    """All that a service and the check of its archive say, or also those of backups; no ids, no times."""
    shapes = [[shape[field] for field in FIELDS] for shape in await _all(client, "/shapes", "shapes")]
    deleted = [shape["name"] for shape in await _all(client, "/deleted", "shapes")]
    jobs = []
    for each in await _all(client, "/jobs", "jobs"):
        files = await _all(client, f"/jobs/{each['id']}/files", "files")
        jobs.append([each["state"], each["counts"], [[file["path"], file["outcome"]] for file in files]])
    sources = []
    for each in await _all(client, "/sources", "sources"):
        files = await _all(client, f"/sources/{each['id']}/files", "files")
        found = sorted([file["path"], file["state"], file["shape_id"] is not None] for file in files)
        sources.append([each["state"], each["counts"], found])
    archives = [
        folder / "archive.sqlite3",
        *sorted((folder / "backups").glob("*.sqlite3") if backups else ()),
    ]
    checks = {path.name: asdict(check(path, lock_seconds=5)) for path in archives}
    for name, report in checks.items():
        assert report["faults"] == [], f"{name}: {report['faults']}"
    state = {"shapes": sorted(shapes), "deleted": deleted, "jobs": jobs, "sources": sources, "checks": checks}
    return json.loads(json.dumps(state))


async def _all(client: httpx.AsyncClient, path: str, what: str) -> list[dict[str, Any]]:
    answer = await client.get(path)
    assert answer.status_code == 200, f"GET {path}: {answer.status_code} {answer.text}"
    return list(answer.json()[what])
