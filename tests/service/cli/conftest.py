"""A small collection on disk, and the command line run in this process against real services."""

import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest
from typer.testing import CliRunner

from core.embedding import Embedding
from core.io import format_of, read_mesh, write_mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from service.app import create_app
from service.cli.commands import command_line
from service.client import Client
from service.datasets import read_collection
from service.evaluation import pairwise_scores
from service.server.uvicorn_server import in_thread
from service.settings import Settings, load_settings
from tests.gallery import make_shape

CLASSES = ("cup", "octopus", "pliers")
POSES = 3


@pytest.fixture(autouse=True)
def environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No setting of the tester's own, one worker, and an empty working folder."""
    for name in [name for name in os.environ if name.startswith("ISOSHAPE_")]:
        monkeypatch.delenv(name)
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
def embeddings(collection: Path) -> list[Embedding]:
    """The embeddings of the collection, by this process."""
    pipeline = Pipeline(DEFAULT)
    files = [path for path, _ in read_collection(collection)]
    return [pipeline.embed(read_mesh(path.read_bytes(), format_of(path.name))) for path in files]


@pytest.fixture
def cup(tmp_path: Path) -> Path:
    path = tmp_path / "a cup.off"
    path.write_bytes(mesh_bytes("cup", 0))
    return path


@pytest.fixture(scope="session")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of the shared service."""
    return tmp_path_factory.mktemp("service") / "archive.sqlite3"


@pytest.fixture(scope="session")
def shared_service(database: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    roots = (str(tmp_path_factory.getbasetemp()),)
    url = f"sqlite:///{database}"
    settings = Settings(database_url=url, workers=1, log_level="error", source_roots=roots)
    with in_thread(create_app(settings)) as client:
        yield client


@contextmanager
def child_in_thread(port: int, settings: Mapping[str, str]) -> Iterator[SimpleNamespace]:
    """In the place of a `ChildService`: a service in a thread of this process, which starts in a second."""
    assert port
    with pytest.MonkeyPatch.context() as patch:
        for name, value in settings.items():
            patch.setenv(name, value)
        app = create_app(load_settings())
    with in_thread(app) as client:
        yield SimpleNamespace(url=client.url, ended=lambda: False)


@pytest.fixture
def archive(shared_service: Client) -> Client:
    """A client of a running service that holds nothing."""
    for shape in list(shared_service.shapes()):
        shared_service.delete(shape.id)
    return shared_service


class Result(NamedTuple):
    """The outcome of a command: its exit status, and the text that it printed where."""

    status: int
    stdout: str
    stderr: str


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
