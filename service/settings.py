"""The settings of the service: environment variables that begin with ISOSHAPE_."""

import base64
import json
import os
import re
from collections.abc import Iterable
from datetime import timedelta
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, PositiveInt, ValidationError, ValidationInfo, field_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from core.errors import ParameterError
from core.io import DEFAULT_LIMITS, Limits
from core.parameters import DEFAULT, PAPER, Parameters
from service.auth.keys import KeyEntry
from service.errors import ExpectedError, fault_text

PREFIX = "ISOSHAPE_"

OTHER_VARIABLES = frozenset({"ISOSHAPE_API_KEY", "ISOSHAPE_COLLECTION", "ISOSHAPE_DATA", "ISOSHAPE_URL"})
"""Variables that the command line and the tests read. The service accepts and ignores them."""

Seconds = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Digests = Annotated[tuple[str, ...], NoDecode]

_HOST = re.compile(r"[A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\]")
_ADDRESS = re.compile(r"https?://[^\s/?#]+(?:[/?][^\s#]*)?")
_SCHEDULER = re.compile(r"(?:tcp|tls)://[^\s/:]+:\d{1,5}")


class SettingsError(ExpectedError):
    """The environment, or the file of parameters that it names, is invalid; the message gives the reason."""

    status = 2


def _bytes_of(secret: str) -> bytes:
    """Return the bytes of a secret in the form of Standard Webhooks; none if it has another form."""
    try:
        return base64.b64decode(secret.removeprefix("whsec_"), validate=True)
    except ValueError:
        return b""


def available_processors() -> int:
    """Return the number of processors that this process may use; if the system does not say, of all."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Settings(BaseSettings):
    """The settings of one service. `docs/settings.md` describes each of them."""

    model_config = SettingsConfigDict(
        env_prefix=PREFIX, extra="forbid", frozen=True, hide_input_in_errors=True
    )

    # Storage, the method, and the address that the service listens on.
    database_url: str = "sqlite:///isoshape-data/isoshape.sqlite3"
    pipeline: str = "default"
    host: str = "127.0.0.1"
    port: int = Field(default=8000, ge=0, le=65535)
    hosts: Annotated[tuple[str, ...], NoDecode] = ()

    # Access.
    api_keys: Digests = ()
    read_keys: Digests = ()
    rate_limit: int = Field(default=1_200, ge=0)
    log_level: Literal["debug", "info", "warning", "error"] = "info"

    # Workers, and the time and memory of a request.
    workers: PositiveInt = Field(default_factory=available_processors)
    scheduler: str = ""
    queue_length: int = Field(default=32, ge=0)
    receive_seconds: Seconds = 20.0
    task_seconds: Seconds = 120.0
    read_seconds: Seconds = 30.0
    read_memory_bytes: int = Field(default=3 * 1024**3, ge=1024**3)
    shutdown_seconds: PositiveInt = 10
    lock_seconds: Seconds = 10.0
    max_upload_bytes: PositiveInt = 128 * 1024**2

    # Bulk jobs.
    job_folder: str = ""
    max_archive_bytes: PositiveInt = 512 * 1024**2
    max_archive_files: PositiveInt = 10_000
    max_unpacked_bytes: PositiveInt = 4 * 1024**3
    max_unpacked_ratio: float = Field(default=200.0, gt=1, allow_inf_nan=False)
    max_jobs: PositiveInt = 16
    job_days: float = Field(default=7.0, gt=0, le=3660, allow_inf_nan=False)

    # Folders in place.
    source_roots: Annotated[tuple[str, ...], NoDecode] = ()

    # Messages about what is new.
    webhook_secret: str = ""
    webhook_url: str = ""

    # Deleted and near-identical shapes.
    undo_days: float = Field(default=7.0, ge=0, le=3660, allow_inf_nan=False)
    duplicates_in_background: bool = True

    # Limits of a mesh file.
    max_vertices: PositiveInt = DEFAULT_LIMITS.vertices
    max_faces: PositiveInt = DEFAULT_LIMITS.faces
    max_parts: PositiveInt = DEFAULT_LIMITS.parts
    max_distinct_parts: PositiveInt = DEFAULT_LIMITS.distinct_parts

    # Search.
    rank_by: Literal["cc", "ssd", "sim", "combined", "contextual"] = "cc"
    shortlist_from: PositiveInt = 2_000
    shortlist_length: PositiveInt = 600
    finalists: PositiveInt = 40
    search_bytes: int = Field(default=1280 * 1024**2, ge=0)
    signatures: Literal["memory", "database"] = "memory"

    @field_validator("database_url")
    @classmethod
    def _names_a_database(cls, database_url: str) -> str:
        # Here, so that a command that needs no database does not wait for the database's imports.
        from sqlalchemy import make_url  # noqa: PLC0415
        from sqlalchemy.exc import ArgumentError  # noqa: PLC0415

        try:
            url = make_url(database_url)
        except ArgumentError as error:
            raise ValueError("not an SQLAlchemy URL, such as sqlite:///folder/file.sqlite3") from error
        is_file = url.drivername in {"sqlite", "sqlite+pysqlite"} and url.database != ":memory:"
        is_postgresql = url.drivername in {"postgresql", "postgresql+psycopg"}
        if not url.database or not (is_file or is_postgresql):
            raise ValueError(
                "must name an SQLite file, as in sqlite:///folder/file.sqlite3, or a PostgreSQL database, as "
                "in postgresql+psycopg://user:password@host/database"
            )
        return database_url

    @field_validator("hosts", mode="before")
    @classmethod
    def _are_names(cls, value: object) -> object:
        if not isinstance(value, str):
            return value
        names = [part.strip() for part in value.split(",") if part.strip()]
        if not all(map(_HOST.fullmatch, names)):
            raise ValueError("must be names or addresses without ports, separated by commas")
        return tuple(names)

    @field_validator("source_roots", mode="before")
    @classmethod
    def _are_folders(cls, value: object) -> object:
        if not isinstance(value, str):
            return value
        folders = [part for part in value.split(os.pathsep) if part]
        if not all(map(os.path.isabs, folders)):
            raise ValueError(f"must be absolute paths of folders, separated by {os.pathsep}")
        return tuple(folders)

    @field_validator("webhook_secret")
    @classmethod
    def _is_a_secret(cls, secret: str) -> str:
        if secret and not 24 <= len(_bytes_of(secret)) <= 64:
            raise ValueError("must be whsec_ and 24 to 64 random bytes in base64")
        return secret

    @field_validator("webhook_url")
    @classmethod
    def _is_an_address(cls, address: str, others: ValidationInfo) -> str:
        if address and not _ADDRESS.fullmatch(address):
            raise ValueError("must be the address of a receiver, as in https://host/path")
        if address and others.data.get("webhook_secret") == "":
            raise ValueError(f"messages are signed: set {PREFIX}WEBHOOK_SECRET too")
        return address

    @field_validator("scheduler")
    @classmethod
    def _names_a_scheduler(cls, scheduler: str) -> str:
        if scheduler and not _SCHEDULER.fullmatch(scheduler):
            raise ValueError("must be the address of a Dask scheduler, as in tcp://host:8786")
        return scheduler

    @field_validator("signatures")
    @classmethod
    def _has_an_index(cls, signatures: str, others: ValidationInfo) -> str:
        if signatures == "database" and not str(others.data.get("database_url", "")).startswith("postgresql"):
            raise ValueError("database needs PostgreSQL; with an SQLite file the signatures are in memory")
        return signatures

    @field_validator("api_keys", "read_keys", mode="before")
    @classmethod
    def _are_digests(cls, value: object) -> object:
        if not isinstance(value, str):
            return value
        try:
            entries = [KeyEntry.read(part) for part in value.split(",") if part.strip()]
        except ValueError as error:
            raise ValueError(
                "must be SHA-256 digests of keys, 64 hexadecimal digits each, separated by commas; a colon "
                "and names joined by + after a digest limit the key to these collections; "
                "`isoshape key` creates a key and prints its digest"
            ) from error
        if len({entry.digest for entry in entries}) < len(set(entries)):
            raise ValueError("a digest is listed twice with different collections")
        return tuple(entry.write() for entry in entries)

    @property
    def has_keys(self) -> bool:
        """Whether requests need a key."""
        return bool(self.api_keys or self.read_keys)

    @property
    def webhook_key(self) -> bytes:
        """The key that signs messages."""
        return _bytes_of(self.webhook_secret)

    @property
    def undo_time(self) -> timedelta:
        """How long a deleted shape can be restored."""
        return timedelta(days=self.undo_days)

    @property
    def limits(self) -> Limits:
        """The limits of a mesh file."""
        return Limits(
            vertices=self.max_vertices,
            faces=self.max_faces,
            parts=self.max_parts,
            distinct_parts=self.max_distinct_parts,
        )


def load_settings() -> Settings:
    """Return the settings in the environment.

    Raise SettingsError if a variable beginning with ISOSHAPE_ is unknown, or a value is out of range.
    """
    known = {PREFIX + name.upper() for name in Settings.model_fields} | OTHER_VARIABLES
    given = {name.upper(): name for name in os.environ if name.upper().startswith(PREFIX)}
    unknown = sorted(given[name] for name in given.keys() - known)
    if unknown:
        raise SettingsError(
            f"unknown settings: {', '.join(_with_suggestion(name, known) for name in unknown)}; "
            "docs/settings.md lists the known ones"
        )
    try:
        return Settings()
    except ValidationError as error:
        problems = (f"{PREFIX}{str(e['loc'][0]).upper()}: {fault_text(e)}" for e in error.errors())
        raise SettingsError("; ".join(problems)) from error


def _with_suggestion(name: str, known: Iterable[str]) -> str:
    """Return a mistyped variable and the known one that is nearest to it."""
    near = get_close_matches(
        name.upper().removeprefix(PREFIX), [one.removeprefix(PREFIX) for one in known], 1
    )
    return f"{name} (did you mean {PREFIX}{near[0]}?)" if near else name


def load_parameters(pipeline: str) -> Parameters:
    """Return the parameters that `pipeline` names; parameters without a name take that of their file.

    Raise SettingsError if `pipeline` names neither built-in parameters nor a readable file of parameters.
    """
    named = {"default": DEFAULT, "paper": PAPER}
    if pipeline in named:
        return named[pipeline]
    try:
        text = Path(pipeline).read_text(encoding="utf-8")
        parameters = Parameters.from_json(text)
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError(
            f"{PREFIX}PIPELINE: neither default nor paper nor a file that can be read: {pipeline!r}: {error}"
        ) from error
    except ParameterError as error:
        raise SettingsError(f"{PREFIX}PIPELINE: {pipeline}: {error}") from error
    return parameters if "name" in json.loads(text) else parameters.with_values(name=Path(pipeline).stem)
