"""An archive that a command opens itself: the whole service, run by this process while the command lasts."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pydantic import ValidationError

from service.auth.keys import digest_of, new_key
from service.client import Client
from service.console import say
from service.errors import ArchiveError
from service.settings import Settings, SettingsError, load_settings


def settings_with(database: str | None) -> Settings:
    """Return the settings of the environment, with the database of the option `--url` where it names one.

    Raises
    ------
    SettingsError
        The environment is wrong, or the address names no database.
    """
    settings = load_settings()
    if not database:
        return settings
    return settings.model_copy(update={"database_url": database_named("--url", database)})


def database_named(argument: str, place: str) -> str:
    """Return the URL of a database; `place` is that URL or the path of an SQLite file.

    Raises
    ------
    SettingsError
        The place names no database; the message begins with the name of the argument.
    """
    url = place if "://" in place else f"sqlite:///{Path(place).absolute()}"
    try:
        return Settings(database_url=url).database_url
    except ValidationError as error:
        raise SettingsError(
            f"{argument}: {error.errors()[0]['msg'].removeprefix('Value error, ')}"
        ) from error


@contextmanager
def own_service(settings: Settings, collection: str | None, *, new: bool) -> Iterator[Client]:
    """Yield a client of a service on the database of the settings, after one line that names the database.

    Raises
    ------
    StartError
        The database cannot be opened.
    ArchiveError
        The database is an SQLite file that does not exist, and `new` is false.
    """
    if not (new or _exists(settings.database_url)):
        raise ArchiveError(
            f"there is no archive at {_without_password(settings.database_url)}; `isoshape ingest` makes one"
        )
    # Here, so that a command that finds a local service does not wait for these imports.
    from service.app import create_app  # noqa: PLC0415
    from service.server.uvicorn_server import in_thread  # noqa: PLC0415

    say(f"using the database {_without_password(settings.database_url)}")
    if "log_level" not in settings.model_fields_set:
        settings = settings.model_copy(update={"log_level": "error"})
    # Other users of this machine reach its port too.
    key = new_key()
    settings = settings.model_copy(update={"api_keys": (digest_of(key),), "read_keys": (), "rate_limit": 0})
    with in_thread(create_app(settings), key, collection) as client:
        yield client


def _exists(database_url: str) -> bool:
    """Return whether an SQLite file exists; a server of databases is asked later."""
    # Here for the same reason.
    from service.storage.sqlite import path_of  # noqa: PLC0415

    return not database_url.startswith("sqlite") or path_of(database_url).exists()


def _without_password(database_url: str) -> str:
    # Here for the same reason.
    from sqlalchemy.engine import make_url  # noqa: PLC0415
    from sqlalchemy.exc import ArgumentError  # noqa: PLC0415

    try:
        return make_url(database_url).render_as_string(hide_password=True)
    except ArgumentError:
        return "that ISOSHAPE_DATABASE_URL names"
