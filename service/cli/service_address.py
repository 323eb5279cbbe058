"""The service that a command talks to."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

import httpx
import typer

from service.client import Client, ClientError, ProblemError
from service.console import say
from service.server.process import DEFAULT_PORT, LOOPBACK

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
        if collection is not None:
            _check_collection(client, collection)
        yield client


def _check_collection(client: Client, collection: str) -> None:
    try:
        client.page(limit=1)
    except ProblemError as error:
        if error.kind != "collection-not-found":
            raise
        raise ClientError(
            f"there is no collection {collection!r}; `isoshape collections --create {collection}` makes one"
        ) from error


@contextmanager
def _client(url: str | None, key: str | None, collection: str | None, *, new: bool) -> Iterator[Client]:
    if url and not _is_database(url):
        with Client(url, key=key, collection=collection) as client:
            client.version()
            say(f"using the service at {url}")
            yield client
        return
    # Here, so that a command that is given the address of a service does not wait for the settings.
    from service.cli.local_service import own_service, settings_with  # noqa: PLC0415

    settings = settings_with(url)
    local = f"http://{LOOPBACK}:{DEFAULT_PORT}"
    if "database_url" not in settings.model_fields_set and _answers(local, key):
        say(f"using the service at {local}")
        with Client(local, key=key, collection=collection) as client:
            yield client
        return
    with own_service(settings, collection, new=new) as client:
        yield client


def _is_database(url: str) -> bool:
    return "://" in url and not url.lower().startswith(("http://", "https://"))


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
