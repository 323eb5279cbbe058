"""The settings of the service: environment variables that begin with ISOSHAPE_."""

import json
import os
import re
from datetime import timedelta
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, PositiveInt, ValidationError, ValidationInfo, field_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict
from sqlalchemy import make_url
from sqlalchemy.exc import ArgumentError

from core.errors import ParameterError
from core.io import DEFAULT_LIMITS, Limits
from core.parameters import DEFAULT, PAPER, Parameters
from service.auth.keys import Entry
from service.storage.hnsw_parameters import HnswParameters

PREFIX = "ISOSHAPE_"

# Read by other parts of the project, so not a mistake in the environment of a service.
OTHER_VARIABLES = frozenset({"ISOSHAPE_API_KEY", "ISOSHAPE_COLLECTION", "ISOSHAPE_DATA", "ISOSHAPE_URL"})

Digests = Annotated[tuple[str, ...], NoDecode]

_SCHEDULER = re.compile(r"(?:tcp|tls)://[^\s/:]+:\d{1,5}")


class SettingsError(Exception):
    """The environment, or the file of parameters it names, cannot be used; the message says why."""


def _processors() -> int:
    """How many processors this process may use, where the system tells, or else how many there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Settings(BaseSettings):
    """What an operator may choose. `docs/settings.md` says what each is for."""

    model_config = SettingsConfigDict(
        env_prefix=PREFIX, extra="forbid", frozen=True, hide_input_in_errors=True
    )

    database_url: str = Field(
        default="sqlite:///isoshape-data/isoshape.sqlite3",
        description="Where everything is stored, as an SQLAlchemy URL: an SQLite file, whose folder is made, "
        "or a PostgreSQL database.",
    )
    pipeline: str = Field(
        default="default",
        description="The method's parameters: default, paper, or the path of a JSON file of parameters.",
    )
    host: str = Field(default="127.0.0.1", description="The address that `isoshape serve` listens on.")
    port: int = Field(
        default=8000,
        ge=0,
        le=65535,
        description="The port that `isoshape serve` listens on; 0 is any free one.",
    )
    api_keys: Digests = Field(
        default=(),
        description="SHA-256 digests of the keys that may do everything, separated by commas; as "
        "digest:name+name, in these collections alone.",
    )
    read_keys: Digests = Field(
        default=(),
        description="SHA-256 digests of the keys that may read, query and compare, separated by commas; as "
        "digest:name+name, in these collections alone.",
    )
    rate_limit: int = Field(
        default=1_200,
        ge=0,
        description="Requests that a key may make at once, and then a minute; 0 is no limit.",
    )
    log_level: Literal["debug", "info", "warning", "error"] = Field(
        default="info", description="The least severe messages that are logged."
    )
    workers: PositiveInt = Field(
        default_factory=_processors,
        description="Worker processes that read, embed and compare. As many as processors unless set.",
    )
    scheduler: str = Field(
        default="",
        description="The address of a Dask scheduler, as tcp://host:8786. Without one, workers are local.",
    )
    queue_length: int = Field(
        default=32,
        ge=0,
        description="Requests that may wait for a worker beyond those at work; the next is answered 503.",
    )
    task_seconds: float = Field(
        default=120.0,
        gt=0,
        allow_inf_nan=False,
        description="The longest that one task may run in a worker before the worker is replaced.",
    )
    read_seconds: float = Field(
        default=30.0,
        gt=0,
        allow_inf_nan=False,
        description="The processor time that reading one file may take.",
    )
    read_memory_bytes: int = Field(
        default=3 * 1024**3,
        ge=512 * 1024**2,
        description="The address space of a process that reads uploads.",
    )
    shutdown_seconds: PositiveInt = Field(
        default=10,
        description="How long `isoshape serve`, asked to stop, goes on with requests that are at work.",
    )
    lock_seconds: float = Field(
        default=10.0,
        gt=0,
        allow_inf_nan=False,
        description="The longest wait for the database's lock before the answer is 503.",
    )
    idempotency_hours: float = Field(
        default=24.0,
        gt=0,
        le=24 * 366,
        allow_inf_nan=False,
        description="How long the answer to an upload with an Idempotency-Key is kept.",
    )
    max_upload_bytes: PositiveInt = Field(
        default=128 * 1024 * 1024, description="The largest file that may be uploaded."
    )
    max_archive_bytes: PositiveInt = Field(
        default=512 * 1024 * 1024, description="The largest archive that a bulk job may be given."
    )
    max_archive_files: PositiveInt = Field(
        default=10_000, description="The most members that an archive may have, folders included."
    )
    max_unpacked_bytes: PositiveInt = Field(
        default=4 * 1024**3, description="The most bytes that an archive may unpack to in all."
    )
    max_unpacked_ratio: float = Field(
        default=200.0,
        gt=1,
        allow_inf_nan=False,
        description="How many times its packed size anything in an archive may unpack to.",
    )
    max_jobs: PositiveInt = Field(
        default=16, description="Bulk jobs that have not ended; the next archive is answered 503."
    )
    job_days: float = Field(
        default=7.0,
        gt=0,
        le=3660,
        allow_inf_nan=False,
        description="How long the record of a bulk job that has ended is kept.",
    )
    undo_days: float = Field(
        default=0.0,
        ge=0,
        le=3660,
        allow_inf_nan=False,
        description="How long a deleted shape can be restored; 0 is not at all, and nothing is kept of it.",
    )
    max_vertices: PositiveInt = Field(
        default=DEFAULT_LIMITS.vertices, description="The most vertices a mesh may have."
    )
    max_faces: PositiveInt = Field(
        default=DEFAULT_LIMITS.faces, description="The most faces a mesh may have."
    )
    max_parts: PositiveInt = Field(
        default=DEFAULT_LIMITS.parts,
        description="The most parts (solids, groups, instances) that a file may be made of.",
    )
    max_form_fields: PositiveInt = Field(
        default=640,
        description="The most fields beside the file in one form. A query may name 500 shapes to leave out, "
        "and 32 of each tag and metadata.",
    )
    shortlist_from: PositiveInt = Field(
        default=5_000,
        description="With at least this many candidates, a query looks only at the nearest by signature.",
    )
    shortlist_length: PositiveInt = Field(
        default=1_000, description="How many of the nearest by signature such a query looks at."
    )
    screened: PositiveInt = Field(
        default=300,
        description="How many of those are looked at more closely: what a rough match finds most alike.",
    )
    finalists: PositiveInt = Field(
        default=20,
        description="How many more than are wanted are compared in full: what that look finds most alike.",
    )
    search_bytes: int = Field(
        default=1280 * 1024**2,
        ge=0,
        description="Memory for searching: signatures and sketches of all shapes, about 900 bytes each, and "
        "embeddings made ready to be compared, about 100 kB each.",
    )

    signatures: Literal["memory", "database"] = Field(
        default="memory",
        description="Where the nearest signatures are looked for: in the memory of the service, or, on "
        "PostgreSQL, by the database, so that none need be in memory.",
    )
    hnsw_m: int = Field(
        default=16,
        ge=2,
        le=100,
        description="On PostgreSQL: to how many others a signature is linked in the graph that is searched.",
    )
    hnsw_ef_construction: int = Field(
        default=200,
        ge=4,
        le=1_000,
        validate_default=True,
        description="On PostgreSQL: how many near ones are kept in mind while a signature is linked.",
    )
    hnsw_ef_search: int = Field(
        default=400,
        ge=1,
        le=1_000,
        description="On PostgreSQL: how many near ones are kept in mind while the graph is searched.",
    )

    @field_validator("database_url")
    @classmethod
    def _names_a_database(cls, database_url: str) -> str:
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

    @field_validator("scheduler")
    @classmethod
    def _names_a_scheduler(cls, scheduler: str) -> str:
        if scheduler and not _SCHEDULER.fullmatch(scheduler):
            raise ValueError("must be the address of a Dask scheduler, as in tcp://host:8786")
        return scheduler

    @field_validator("signatures")
    @classmethod
    def _can_be_looked_for(cls, signatures: str, others: ValidationInfo) -> str:
        if signatures == "database" and not str(others.data.get("database_url", "")).startswith("postgresql"):
            raise ValueError("database is for PostgreSQL; an SQLite file has its signatures in memory")
        return signatures

    @field_validator("hnsw_ef_construction")
    @classmethod
    def _makes_a_graph(cls, ef_construction: int, others: ValidationInfo) -> int:
        if ef_construction < 2 * int(others.data.get("hnsw_m", 2)):
            raise ValueError(f"must be at least twice {PREFIX}HNSW_M")
        return ef_construction

    @field_validator("api_keys", "read_keys", mode="before")
    @classmethod
    def _are_digests(cls, value: object) -> object:
        if not isinstance(value, str):
            return value
        try:
            entries = [Entry.read(part) for part in value.split(",") if part.strip()]
        except ValueError as error:
            raise ValueError(
                "must be SHA-256 digests of keys, of 64 hexadecimal digits each, separated by commas, and "
                "behind those that are limited to collections a colon and their names, joined by +; "
                "`isoshape key` makes a key and prints its digest"
            ) from error
        if len({entry.digest for entry in entries}) < len(set(entries)):
            raise ValueError("a digest stands there twice, with different collections")
        return tuple(entry.write() for entry in entries)

    @property
    def has_keys(self) -> bool:
        """Whether requests need a key."""
        return bool(self.api_keys or self.read_keys)

    @property
    def graph(self) -> HnswParameters:
        """How graphs of signatures are made and searched."""
        return HnswParameters(
            m=self.hnsw_m, ef_construction=self.hnsw_ef_construction, ef_search=self.hnsw_ef_search
        )

    @property
    def undo_time(self) -> timedelta:
        """How long a deleted shape can be restored."""
        return timedelta(days=self.undo_days)

    @property
    def limits(self) -> Limits:
        """What a file may hold at most."""
        return Limits(vertices=self.max_vertices, faces=self.max_faces, parts=self.max_parts)


def load_settings() -> Settings:
    """The settings in the environment.

    Raises
    ------
    SettingsError
        A variable beginning with ISOSHAPE_ is not one of them, or a value is out of range.
    """
    known = {PREFIX + name.upper() for name in Settings.model_fields} | OTHER_VARIABLES
    ours = (name for name in os.environ if name.upper().startswith(PREFIX))
    unknown = sorted(name for name in ours if name.upper() not in known)
    if unknown:
        raise SettingsError(
            f"unknown settings: {', '.join(unknown)}; the known ones are {', '.join(sorted(known))}"
        )
    try:
        return Settings()
    except ValidationError as error:
        problems = [
            f"{PREFIX}{str(e['loc'][0]).upper()}: {e['msg'].removeprefix('Value error, ')}"
            for e in error.errors()
        ]
        raise SettingsError("; ".join(problems)) from error


def load_parameters(pipeline: str) -> Parameters:
    """The parameters that the setting `pipeline` names; a file that gives them no name gives its own.

    Raises
    ------
    SettingsError
        It names neither a setting nor a readable file of parameters.
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
