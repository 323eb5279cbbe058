"""`isoshape serve`, `isoshape compile` and `isoshape openapi`."""

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from socket import socket
from typing import Annotated

import httpx
import typer

from core.parameters import Parameters
from service.client import Client
from service.compute.compilation import compile_kernels, is_compiled
from service.console import fail, progress, say
from service.errors import ArchiveServedError
from service.server.process import LOOPBACK, StartError, bind, is_loopback, wait_until_ready
from service.settings import SettingsError, load_parameters, load_settings

PROBE = httpx.Timeout(5.0)
END_SECONDS = 1.0

SOUND_PYTHONS = {(3, 11): 10, (3, 12): 6}
"""The first patch release of each Python without known holes that requests reach: ZIPs whose members overlap
(CVE-2024-0450) and cookies that take quadratic time (CVE-2024-7592). Later Pythons have none of them."""


def serve_command(
    host: Annotated[
        str | None, typer.Option(help="Address to listen on. [default: ISOSHAPE_HOST or 127.0.0.1]")
    ] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port. [default: ISOSHAPE_PORT or 8000; 0: any free]")
    ] = None,
    shared: Annotated[
        bool, typer.Option("--shared", help="Start although another service serves the same SQLite archive.")
    ] = False,
) -> None:
    """Serve the archive over HTTP until Ctrl-C.

    The settings are the variables ISOSHAPE_* of the environment. Without a key the service listens only on an
    address that other machines cannot reach. One service serves an SQLite archive, unless all but the first
    are started with --shared; a PostgreSQL database may have any number.
    """
    # Here, so that the help does not wait for these imports.
    from service.app import create_app  # noqa: PLC0415
    from service.server.uvicorn_server import run  # noqa: PLC0415

    settings = load_settings()
    with bind(host or settings.host, settings.port if port is None else port) as bound:
        address = bound.getsockname()
        if not (settings.has_keys or is_loopback(address[0])):
            raise SettingsError(
                f"{address[0]} can be reached from other machines, and anybody could change the archive: "
                "set ISOSHAPE_API_KEYS to the SHA-256 of a key (`isoshape key` makes one and prints both), "
                "or listen on 127.0.0.1"
            )
        url = _url(*address[:2])
        # The address of the option is one of the names under which the service answers.
        settings = settings.model_copy(update={"host": host or settings.host})
        with nullcontext() if shared else _alone(settings.database_url, url):
            say(f"Isoshape starts on {url}")
            warn_of_python(sys.version_info[:3])
            with (
                compiling(load_parameters(settings.pipeline), settings.scheduler),
                told_when_ready(bound, url),
            ):
                run(create_app(settings, watches=True), bound, settings.shutdown_seconds)


def warn_of_python(version: tuple[int, int, int]) -> None:
    """Say that a Python has known holes, if it has."""
    sound = SOUND_PYTHONS.get(version[:2], 0)
    if version[2] < sound:
        series = ".".join(map(str, version[:2]))
        say(
            f"Warning: Python {series}.{version[2]} has known security holes that requests can reach; "
            f"update to {series}.{sound} or newer."
        )


def _alone(database_url: str, url: str) -> AbstractContextManager[object]:
    """Return the lock of the one service of an SQLite archive; a PostgreSQL database needs none.

    Raise ArchiveServedError if another service serves the archive.
    """
    # Here for the same reason.
    from service.storage.sqlite import ServingLock, path_of  # noqa: PLC0415

    if not database_url.startswith("sqlite"):
        return nullcontext()
    try:
        return ServingLock(path_of(database_url), url)
    except ArchiveServedError as error:
        raise ArchiveServedError(
            f"{error}: use that service, or start this one with --shared, or name another archive in "
            "ISOSHAPE_DATABASE_URL"
        ) from error


@contextmanager
def compiling(parameters: Parameters, scheduler: str) -> Iterator[None]:
    """Show the compilation of missing kernels, in a process of its own, for which the workers wait.

    The memory of a compiler would stay with the service. Workers of a cluster compile where they are.
    """
    if scheduler or is_compiled(parameters):
        yield
        return
    # -P: files in the working folder are not part of the program.
    process = subprocess.Popen([sys.executable, "-P", "-m", "service.cli", "compile"])
    try:
        yield
    finally:
        process.terminate()
        process.wait()


@contextmanager
def told_when_ready(bound: socket, url: str) -> Iterator[None]:
    """Say that the service listens once it is ready, if it becomes so during the block."""
    ended = threading.Event()

    def watch() -> None:
        with suppress(StartError), Client(_reachable(bound), timeout=PROBE) as client:
            wait_until_ready(client, ended.is_set)
            say(f"Isoshape listens on {url}")

    thread = threading.Thread(target=watch, daemon=True, name="isoshape-ready")
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(END_SECONDS)


def _reachable(bound: socket) -> str:
    """Return the address at which this process reaches a socket that may listen on all addresses."""
    host, port = bound.getsockname()[:2]
    return _url({"::": "::1", "0.0.0.0": LOOPBACK}.get(host, host), port)


def _url(host: str, port: int) -> str:
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def compile_command() -> None:
    """Compile the kernels for this processor, once.

    numba keeps them beside the sources, or in the folder that NUMBA_CACHE_DIR names. ISOSHAPE_PIPELINE names
    the pipeline. A service compiles what is missing when it starts; this command does it in advance, as when
    Isoshape is installed.
    """
    parameters = load_parameters(load_settings().pipeline)
    if is_compiled(parameters):
        say("the kernels are compiled for this processor")
        return
    try:
        compile_with_bar(parameters)
    except KeyboardInterrupt:
        fail("stopped; the next start goes on", status=130)


def compile_with_bar(parameters: Parameters) -> None:
    """Compile the kernels that are missing, and show the progress."""
    say("compiling for this processor, once; it takes about a minute on an idle machine")
    start = time.monotonic()
    with progress() as bar:
        task = bar.add_task("compiling", total=None)
        compile_kernels(parameters, lambda done, total: bar.update(task, completed=done, total=total))
    say(f"compiled in {time.monotonic() - start:.0f} s")


def openapi_command(
    output: Annotated[Path, typer.Option(help="File to write, or - for standard output.")] = Path(
        "openapi/openapi.json"
    ),
) -> None:
    """Write the OpenAPI document of the service."""
    # Here, so that `isoshape serve` binds its port before the service is imported.
    from service.app import openapi_text  # noqa: PLC0415

    text = openapi_text()
    if output == Path("-"):
        typer.echo(text, nl=False)
    else:
        output.parent.mkdir(parents=True, exist_ok=True)
        output.write_text(text, encoding="utf-8")
