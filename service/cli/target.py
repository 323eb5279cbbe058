"""Which service a command talks to."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import httpx
import typer
from pydantic import ValidationError
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError

from service.auth.keys import digest_of, new_key
from service.client import Client, ClientError, ProblemError
from service.console import say
from service.server.uvicorn_server import DEFAULT_PORT, LOOPBACK, in_thread
from service.settings import Settings, SettingsError, load_settings

Url = Annotated[
    str | None,
    typer.Option(
        envvar="ISOSHAPE_URL",
        help="Address of the service, or of a database, as sqlite:///folder/file.sqlite3. Without one: the "
        "database that ISOSHAPE_DATABASE_URL names; else a service at "
        f"{LOOPBACK}:{DEFAULT_PORT}; else the default database.",
    ),
]

Key = Annotated[
    str | None,
    typer.Option(
        envvar="ISOSHAPE_API_KEY",
        help="The key to send, where the service asks for one. Better in the environment: others see what "
        "is in the command line.",
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

# A local service answers at once, or is none.
PROBE = httpx.Timeout(2.0)


@contextmanager
def service_at(url: str | None, key: str | None = None, collection: str | None = None) -> Iterator[Client]:
    """A client of the service that is meant, and of its collection, after one line that says which it is.

    A database is reached through the whole service, run by this process for as long as the command lasts; its
    settings are those of the environment.

    Raises
    ------
    ClientError
        There is no such service at the address given, or it wants another key, or has no such collection.
    StartError
        The database cannot be opened.
    SettingsError
        The environment is wrong, or the address is that of no database.
    """
    with _client(url, key, collection) as client:
        if collection is not None:
            client.page(limit=1)
        yield client


@contextmanager
def _client(url: str | None, key: str | None, collection: str | None) -> Iterator[Client]:
    if url and "://" in url and not url.lower().startswith(("http://", "https://")):
        settings = load_settings()
        settings = settings.model_copy(update={"database_url": database_named("--url", url)})
        say(f"using the database {_shown(settings.database_url)}")
        with _own_service(settings, collection) as client:
            yield client
        return
    if url:
        with Client(url, key=key, collection=collection) as client:
            client.version()
            say(f"using the service at {url}")
            yield client
        return
    settings = load_settings()
    local = f"http://{LOOPBACK}:{DEFAULT_PORT}"
    if "database_url" not in settings.model_fields_set and _answers(local, key):
        say(f"using the service at {local}")
        with Client(local, key=key, collection=collection) as client:
            yield client
        return
    say(f"using the database {_shown(settings.database_url)}")
    with _own_service(settings, collection) as client:
        yield client


def database_named(argument: str, place: str) -> str:
    """The URL of a database, which may be named by the path of a file.

    Raises
    ------
    SettingsError
        It is none.
    """
    url = place if "://" in place else f"sqlite:///{Path(place).absolute()}"
    try:
        return Settings(database_url=url).database_url
    except ValidationError as error:
        raise SettingsError(
            f"{argument}: {error.errors()[0]['msg'].removeprefix('Value error, ')}"
        ) from error


def _answers(url: str, key: str | None) -> bool:
    try:
        with Client(url, key=key, timeout=PROBE) as client:
            client.version()
    except ProblemError:
        raise
    except ClientError:
        return False
    return True


@contextmanager
def _own_service(settings: Settings, collection: str | None) -> Iterator[Client]:
    # Here, so that a command that talks to a service elsewhere does not wait for its imports.
    from service.app import create_app  # noqa: PLC0415

    if "log_level" not in settings.model_fields_set:
        settings = settings.model_copy(update={"log_level": "error"})
    # Other users of this machine reach its port too.
    key = new_key()
    settings = settings.model_copy(update={"api_keys": (digest_of(key),), "read_keys": (), "rate_limit": 0})
    with in_thread(create_app(settings), key, collection) as client:
        yield client


def _shown(database_url: str) -> str:
    """The address without its password."""
    try:
        return make_url(database_url).render_as_string(hide_password=True)
    except ArgumentError:
        return "that ISOSHAPE_DATABASE_URL names"
