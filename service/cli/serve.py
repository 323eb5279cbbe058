"""`isoshape serve`: the service in the foreground."""

from contextlib import AbstractContextManager, nullcontext
from typing import Annotated

import typer

from service.console import say
from service.errors import ArchiveServedError
from service.server.process import bind, is_loopback
from service.settings import SettingsError, load_parameters, load_settings


def command(
    host: Annotated[
        str | None, typer.Option(help="Address to listen on. [default: ISOSHAPE_HOST or 127.0.0.1]")
    ] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port. [default: ISOSHAPE_PORT or 8000; 0: any free]")
    ] = None,
    shared: Annotated[
        bool,
        typer.Option("--shared", help="Start although another service serves the same SQLite archive."),
    ] = False,
) -> None:
    """Serve the archive over HTTP until Ctrl-C.

    The settings are the variables ISOSHAPE_* of the environment. Without a key the service listens only on an
    address that other machines cannot reach. One service serves an SQLite archive, unless all but the first
    are started with --shared; a PostgreSQL database may have any number.
    """
    # Here, so that the help does not wait for these imports.
    from service.app import create_app  # noqa: PLC0415
    from service.cli.starting import compiling, told_when_ready  # noqa: PLC0415
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
        name = f"[{address[0]}]" if ":" in address[0] else address[0]
        url = f"http://{name}:{address[1]}"
        # The address of the option is one of the names under which the service answers.
        settings = settings.model_copy(update={"host": host or settings.host})
        with nullcontext() if shared else _alone(settings.database_url, url):
            say(f"Isoshape starts on {url}")
            with (
                compiling(load_parameters(settings.pipeline), settings.scheduler),
                told_when_ready(bound, url),
            ):
                run(create_app(settings), bound, settings.shutdown_seconds)


def _alone(database_url: str, url: str) -> AbstractContextManager[object]:
    """The lock of the one service of an SQLite archive; a PostgreSQL database needs none.

    Raises
    ------
    ArchiveServedError
        Another service serves the archive.
    """
    # Here for the same reason.
    from service.storage.lock import ServingLock  # noqa: PLC0415
    from service.storage.sqlite import path_of  # noqa: PLC0415

    if not database_url.startswith("sqlite"):
        return nullcontext()
    try:
        return ServingLock(path_of(database_url), url)
    except ArchiveServedError as error:
        raise ArchiveServedError(
            f"{error}: use that service, or start this one with --shared, or name another archive in "
            "ISOSHAPE_DATABASE_URL"
        ) from error
