"""The service that a command talks to: at an address, or run by this process on a database."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import httpx
import typer
from pydantic import ValidationError

from service.auth.keys import digest_of, new_key
from service.client import Client, ClientError, ProblemError
from service.console import say
from service.errors import ArchiveError, fault_text
from service.server.process import DEFAULT_PORT, LOOPBACK

if TYPE_CHECKING:
    from service.settings import Settings

Url = Annotated[
    str | None,
    typer.Option(
        envvar="ISOSHAPE_URL",
        help="Address of the service, or of a database, as sqlite:///folder/file.sqlite3. [default: the "
        "database of ISOSHAPE_DATABASE_URL, or else a service at "
        f"{LOOPBACK}:{DEFAULT_PORT}, or else the default database]",
    ),
]

Key = Annotated[
    str | None,
    typer.Option(
        envvar="ISOSHAPE_API_KEY",
        help="The key to send, where the service asks for one. Prefer the environment: other users of the "
        "machine can read a command line.",
    ),
]

Collection = Annotated[
    str | None,
    typer.Option(
        envvar="ISOSHAPE_COLLECTION",
        metavar="NAME",
        help="The collection to work in, which `isoshape collections --create` makes. [default: default]",
    ),
]

PROBE = httpx.Timeout(2.0)
"""The time that a service on this machine has to answer, in seconds."""


@contextmanager
def service_at(
    url: str | None, key: str | None = None, collection: str | None = None, *, new: bool = False
) -> Iterator[Client]:
    """Yield a client of a service and of one collection, after one line that names the service.

    With `new`, an SQLite archive that does not exist is made.

    This process runs the whole service on a database for as long as the command lasts, with the settings of
    the environment.

    Raises
    ------
    ClientError
        No service answers at the address, the service wants another key, or the collection does not exist.
    ArchiveError
        There is no archive at the path of the database.
    StartError
        The database cannot be opened.
    SettingsError
        The environment is wrong, or the address names no database.
    """
    with _client(url, key, collection, new=new) as client:
        try:
            if collection is not None:
                client.page(limit=1)
        except ProblemError as error:
            if error.kind != "collection-not-found":
                raise
            raise ClientError(
                f"there is no collection {collection!r}; "
                f"`isoshape collections --create {collection}` makes one"
            ) from error
        yield client


@contextmanager
def _client(url: str | None, key: str | None, collection: str | None, *, new: bool) -> Iterator[Client]:
    if not url or ("://" in url and not url.lower().startswith(("http://", "https://"))):
        # Here, so that a command that is given the address of a service does not wait for the settings.
        from service.settings import load_settings  # noqa: PLC0415

        settings = load_settings()
        if url:
            settings = settings.model_copy(update={"database_url": database_named("--url", url)})
        url = f"http://{LOOPBACK}:{DEFAULT_PORT}"
        if "database_url" in settings.model_fields_set or not _answers(url, key):
            with _own_service(settings, collection, new=new) as client:
                yield client
            return
    with Client(url, key=key, collection=collection) as client:
        client.version()
        say(f"using the service at {url}")
        yield client


def _answers(url: str, key: str | None) -> bool:
    """Return whether a service answers; a service that refuses the key is a ProblemError."""
    try:
        with Client(url, key=key, timeout=PROBE) as client:
            client.version()
    except ProblemError:
        raise
    except ClientError:
        return False
    return True


def database_named(argument: str, place: str) -> str:
    """Return the URL of a database; `place` is that URL or the path of an SQLite file.

    Raise SettingsError, with the name of the argument in its message, if the place names no database.
    """
    # Here for the same reason.
    from service.settings import Settings, SettingsError  # noqa: PLC0415

    url = place if "://" in place else f"sqlite:///{Path(place).absolute()}"
    try:
        return Settings(database_url=url).database_url
    except ValidationError as error:
        raise SettingsError(f"{argument}: {fault_text(error.errors()[0])}") from error


def serves(url: str, database_url: str) -> bool:
    """Return whether the service at an address is the one that has the lock of an SQLite archive."""
    # Here for the same reason.
    from service.storage.sqlite import address_of_service, path_of  # noqa: PLC0415

    held = address_of_service(path_of(database_url)) if database_url.startswith("sqlite") else None
    if held is None:
        return False
    asked, bound = httpx.URL(url), httpx.URL(held)
    host = LOOPBACK if asked.host == "localhost" else asked.host
    everywhere = bound.host in {"0.0.0.0", "::"} and host in {LOOPBACK, "::1"}
    return asked.port == bound.port and (host == bound.host or everywhere)


@contextmanager
def _own_service(settings: "Settings", collection: str | None, *, new: bool) -> Iterator[Client]:
    # Here, so that a command that finds a service does not wait for these imports.
    from sqlalchemy.engine import make_url  # noqa: PLC0415

    from service.storage.sqlite import path_of  # noqa: PLC0415

    named = make_url(settings.database_url).render_as_string(hide_password=True)
    # A server of databases is asked later.
    if not (new or not settings.database_url.startswith("sqlite") or path_of(settings.database_url).exists()):
        raise ArchiveError(f"there is no archive at {named}; `isoshape ingest` makes one")
    from service.app import create_app  # noqa: PLC0415
    from service.server.uvicorn_server import in_thread  # noqa: PLC0415

    say(f"using the database {named}")
    # Other users of this machine reach its port too.
    key = new_key()
    changes: dict[str, Any] = {"api_keys": (digest_of(key),), "read_keys": (), "rate_limit": 0}
    # Who runs the command may read its folders anyway.
    changes["source_roots"] = (os.sep,)
    if "log_level" not in settings.model_fields_set:
        changes["log_level"] = "error"
    with in_thread(create_app(settings.model_copy(update=changes)), key, collection) as client:
        yield client
