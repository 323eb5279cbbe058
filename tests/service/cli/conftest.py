"""A small collection on disk, and the command line run in this process against real services."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from core.gallery import make_shape
from core.io import write_mesh
from service.app import create_app
from service.cli.commands import command_line
from service.client import Client
from service.evaluation import pairwise_scores
from service.server.uvicorn_server import in_thread
from service.settings import Settings

CLASSES = ("cup", "octopus", "pliers")
POSES = 3


@pytest.fixture(autouse=True)
def environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No setting of the tester's own, one worker, and an empty working folder."""
    for name in (
        "DATABASE_URL",
        "URL",
        "PIPELINE",
        "LOG_LEVEL",
        "HOST",
        "PORT",
        "API_KEY",
        "COLLECTION",
        "API_KEYS",
        "READ_KEYS",
    ):
        monkeypatch.delenv(f"ISOSHAPE_{name}", raising=False)
    monkeypatch.setenv("ISOSHAPE_WORKERS", "1")
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")


class KeptPool(ProcessPoolExecutor):
    """Worker processes that outlive the command that asks for them."""

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the processes to the next command."""


@pytest.fixture(scope="session")
def kept_pools() -> Iterator[Callable[..., Executor]]:
    """Pools of worker processes, one for each way to ask for one."""
    with ExitStack() as stack:

        @cache
        def pool(*arguments: Any, **named: Any) -> Executor:
            kept = KeptPool(*arguments, **named)
            stack.callback(ProcessPoolExecutor.shutdown, kept)
            return kept

        yield pool


@pytest.fixture(autouse=True)
def shared_processes(kept_pools: Callable[..., Executor], monkeypatch: pytest.MonkeyPatch) -> None:
    """Studies share their worker processes: starting one takes two seconds."""
    monkeypatch.setattr(pairwise_scores, "ProcessPoolExecutor", kept_pools)


@cache
def mesh_bytes(label: str, pose: int, format: str = "off") -> bytes:
    return write_mesh(make_shape(label, pose), format)


@pytest.fixture(scope="session")
def collection(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of class folders, in three formats."""
    folder = tmp_path_factory.mktemp("collections") / "made"
    for label in CLASSES:
        (folder / label).mkdir(parents=True)
        for pose in range(POSES):
            format = ("off", "stl", "glb")[pose % 3]
            path = folder / label / f"{label}-{pose}.{format}"
            path.write_bytes(mesh_bytes(label, pose, format))
    return folder


@pytest.fixture(scope="session")
def shared_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    database = tmp_path_factory.mktemp("service") / "archive.sqlite3"
    settings = Settings(database_url=f"sqlite:///{database}", workers=1, log_level="error")
    with in_thread(create_app(settings)) as client:
        yield client


@pytest.fixture
def archive(shared_service: Client) -> Client:
    """A client of a running service that holds nothing."""
    for shape in list(shared_service.shapes()):
        shared_service.delete(shape.id)
    return shared_service


class Result:
    """What a command left: its exit status, and what it printed where."""

    def __init__(self, status: int, stdout: str, stderr: str) -> None:
        self.status, self.stdout, self.stderr = status, stdout, stderr


Run = Callable[..., Result]


@pytest.fixture
def run() -> Run:
    """Run `isoshape` with arguments; an error that no command expects is raised."""

    def run(*arguments: object) -> Result:
        done = CliRunner().invoke(command_line(), [str(argument) for argument in arguments])
        if done.exception is not None and not isinstance(done.exception, SystemExit):
            raise done.exception
        return Result(done.exit_code, done.stdout, done.stderr)

    return run
