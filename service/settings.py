"""The settings of the service: environment variables that begin with ISOSHAPE_."""

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
from service.errors import ExpectedError

PREFIX = "ISOSHAPE_"

OTHER_VARIABLES = frozenset({"ISOSHAPE_API_KEY", "ISOSHAPE_COLLECTION", "ISOSHAPE_DATA", "ISOSHAPE_URL"})
"""Variables that the command line and the tests read. The service accepts and ignores them."""

Seconds = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Digests = Annotated[tuple[str, ...], NoDecode]

_HOST = re.compile(r"[A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\]")
_SCHEDULER = re.compile(r"(?:tcp|tls)://[^\s/:]+:\d{1,5}")


class SettingsError(ExpectedError):
    """The environment, or the file of parameters that it names, is invalid; the message gives the reason."""

    status = 2


def _processors() -> int:
    """Return the number of processors that this process may use; if the system does not say, of all."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Settings(BaseSettings):
    """The settings of one service. `docs/settings.md` describes each of them."""

    model_config = SettingsConfigDict(
        env_prefix=PREFIX, extra="forbid", frozen=True, hide_input_in_errors=True
    )

    database_url: str = Field(
        default="sqlite:///isoshape-data/isoshape.sqlite3",
        description="The database of the archive, as an SQLAlchemy URL. sqlite:/// and a path name an "
        "SQLite file (three slashes begin a relative path, four an absolute one) on a local "
        "disk; a missing folder is created. "
        "postgresql+psycopg://user:password@host/database names a PostgreSQL database.",
    )
    pipeline: str = Field(
        default="default",
        description="The parameters of the method: default, paper, or the path of a JSON file of "
        "parameters. An archive with shapes keeps the parameters of its embeddings until "
        "`isoshape reembed` has run.",
    )
    host: str = Field(
        default="127.0.0.1",
        description="The address that `isoshape serve` listens on: 0.0.0.0 in a container, or to serve "
        "a network.",
    )
    port: int = Field(
        default=8000,
        ge=0,
        le=65535,
        description="The port that `isoshape serve` listens on; 0 chooses a free port.",
    )
    hosts: Annotated[tuple[str, ...], NoDecode] = Field(
        default=(),
        description="Names under which the service answers, separated by commas, without ports, besides "
        "localhost, loopback addresses and `ISOSHAPE_HOST`. A request with another Host is "
        "answered 421: without keys always, with keys if this is set.",
    )
    api_keys: Digests = Field(
        default=(),
        description="SHA-256 digests of the keys with full access, separated by commas; "
        "digest:name+name limits a key to the collections named. `isoshape key` prints both "
        "forms. When any key is set, here or below, a request without a key is answered "
        "401. A service that others can reach needs one.",
    )
    read_keys: Digests = Field(
        default=(),
        description="SHA-256 digests of the keys that may read, query and compare, in the same form. A "
        "request that would change something is answered 403.",
    )
    rate_limit: int = Field(
        default=1_200,
        ge=0,
        description="Requests that a key may make in one burst, and per minute after it; the next is "
        "answered 429 with Retry-After. 0 is no limit.",
    )
    log_level: Literal["debug", "info", "warning", "error"] = Field(
        default="info",
        description="The lowest severity of the messages that are logged: debug (also the health "
        "probes), info, warning or error.",
    )
    workers: PositiveInt = Field(
        default_factory=_processors,
        description="Worker processes that embed and compare meshes, one thread each, each paired with "
        "a process that reads uploads. The default is one per processor.",
    )
    scheduler: str = Field(
        default="",
        description="The address of a Dask scheduler, as tcp://host:8786, whose workers embed meshes "
        "and draw pictures in place of local ones. `ISOSHAPE_WORKERS` is then the number of "
        "tasks that the service submits at a time.",
    )
    queue_length: int = Field(
        default=32,
        ge=0,
        description="Requests that may wait for a worker, besides those that have one; the next is "
        "answered 503 with Retry-After. Each waiting upload holds its file in memory and in "
        "the temporary folder.",
    )
    receive_seconds: Seconds = Field(
        default=20.0,
        description="The longest wait for the next bytes of a request's body; the request is then "
        "answered 408. In each further such period 64 KiB must arrive.",
    )
    task_seconds: Seconds = Field(
        default=120.0,
        description="The time limit of one task in a worker. A worker that exceeds it is replaced; its "
        "file is refused with 422, its comparison with 503.",
    )
    read_seconds: Seconds = Field(
        default=30.0,
        description="The limit of processor time for reading one file; a file that needs more is "
        "refused with 422.",
    )
    read_memory_bytes: int = Field(
        default=3 * 1024**3,
        ge=1024**3,
        description="The limit of the address space of a process that reads uploads (Linux), at least 1 "
        "GiB. Reading a file may need twenty times its size; a file that needs more is "
        "refused with 422.",
    )
    shutdown_seconds: PositiveInt = Field(
        default=10,
        description="How long `isoshape serve` finishes running and waiting requests after it is told "
        "to stop; the rest are answered 503. Keep it below `stop_grace_period` of "
        "docker/compose.yaml.",
    )
    lock_seconds: Seconds = Field(
        default=10.0,
        description="The longest wait for the lock of the database; the answer is then 503 with Retry-After.",
    )
    max_upload_bytes: PositiveInt = Field(
        default=128 * 1024 * 1024,
        description="The largest file that may be uploaded; larger ones are answered 413. A worker may "
        "need twenty times the size of a file.",
    )
    job_folder: str = Field(
        default="",
        description="The folder of the archives of unfinished bulk jobs; a missing folder is created. The "
        "default is a folder beside the SQLite file, or isoshape-data/jobs with PostgreSQL. Services that "
        "share a PostgreSQL database need one folder that all of them reach.",
    )
    max_archive_bytes: PositiveInt = Field(
        default=512 * 1024 * 1024,
        description="The largest archive that a bulk job accepts; larger ones are answered 413. The "
        "temporary folder may hold two archives of each key at a time.",
    )
    max_archive_files: PositiveInt = Field(
        default=10_000,
        description="The largest number of members of an archive, folders included. A job with more "
        "fails and stores nothing.",
    )
    max_unpacked_bytes: PositiveInt = Field(
        default=4 * 1024**3,
        description="The largest total size of an unpacked archive. A job with more fails and stores "
        "nothing.",
    )
    max_unpacked_ratio: float = Field(
        default=200.0,
        gt=1,
        allow_inf_nan=False,
        description="The largest ratio of unpacked size to packed size of a member of an archive, from "
        "1 MiB of unpacked data on. Meshes are seldom compressed to less than "
        "a thirtieth.",
    )
    max_jobs: PositiveInt = Field(
        default=16,
        description="The most unfinished bulk jobs; the next archive is answered 503 with Retry-After.",
    )
    job_days: float = Field(
        default=7.0,
        gt=0,
        le=3660,
        allow_inf_nan=False,
        description="How long the service keeps the record of a finished bulk job and the outcome of "
        "each of its files.",
    )
    undo_days: float = Field(
        default=7.0,
        ge=0,
        le=3660,
        allow_inf_nan=False,
        description="How many days a deleted shape can be restored; with 0 it is erased at once. Until "
        "then its file occupies space in the database.",
    )
    duplicates_in_background: bool = Field(
        default=True,
        description="Whether the service searches for near-identical shapes while it is idle. With "
        "false, or with `ISOSHAPE_SIGNATURES=database`, only `GET /duplicates` and "
        "`isoshape duplicates` search.",
    )
    max_vertices: PositiveInt = Field(
        default=DEFAULT_LIMITS.vertices,
        description="The largest number of vertices of a mesh; larger ones are answered 422.",
    )
    max_faces: PositiveInt = Field(
        default=DEFAULT_LIMITS.faces,
        description="The largest number of faces of a mesh; larger ones are answered 422.",
    )
    max_parts: PositiveInt = Field(
        default=DEFAULT_LIMITS.parts,
        description="The largest number of parts in a file (solids of an STL, groups of an OBJ, "
        "instances of a GLB or of a 3MF's objects, parts of a STEP); more are answered 422.",
    )
    max_distinct_parts: PositiveInt = Field(
        default=DEFAULT_LIMITS.distinct_parts,
        description="The largest number of different parts of an assembly that is uploaded with "
        "split=parts; more are answered 422.",
    )
    shortlist_from: PositiveInt = Field(
        default=2_000,
        description="With at least this many candidates, a query compares only a shortlist. With fewer, "
        "or with exhaustive=true, it compares all candidates.",
    )
    shortlist_length: PositiveInt = Field(
        default=1_000,
        description="How many candidates of the shortlist are the nearest by signature; the nearest by "
        "view signature, half as many, join them. Coarse ranking orders them.",
    )
    reranked: PositiveInt = Field(
        default=300,
        description="How many shapes of the shortlist, the best of coarse ranking, are re-ranked: "
        "matched without splines of the candidates. Twice as many for rank_by=combined and "
        "a query that looks incomplete.",
    )
    finalists: PositiveInt = Field(
        default=16,
        description="How many re-ranked shapes, the best ones, are compared in full besides the number "
        "of answers requested.",
    )
    search_bytes: int = Field(
        default=1280 * 1024**2,
        ge=0,
        description="Memory for search: about 1,060 bytes for each shape (signatures, view signatures, "
        "coarse samples), and, in the rest but at least a quarter, caches of points, about "
        "12 kB each, and of match records, about 100 kB each. Higher, where more than "
        "10,000 shapes are searched exhaustively.",
    )

    signatures: Literal["memory", "database"] = Field(
        default="memory",
        description="Where the nearest signatures are found: in the memory of the service or, on "
        "PostgreSQL, by the database, with an HNSW index, which takes no memory of the "
        "service.",
    )

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

    Raises
    ------
    SettingsError
        A variable beginning with ISOSHAPE_ is unknown, or a value is out of range.
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
        problems = [
            f"{PREFIX}{str(e['loc'][0]).upper()}: {e['msg'].removeprefix('Value error, ')}"
            for e in error.errors()
        ]
        raise SettingsError("; ".join(problems)) from error


def _with_suggestion(name: str, known: Iterable[str]) -> str:
    """Return a mistyped variable and the known one that is nearest to it."""
    near = get_close_matches(
        name.upper().removeprefix(PREFIX), [one.removeprefix(PREFIX) for one in known], 1
    )
    return f"{name} (did you mean {PREFIX}{near[0]}?)" if near else name


def load_parameters(pipeline: str) -> Parameters:
    """Return the parameters that `pipeline` names; parameters without a name take that of their file.

    Raises
    ------
    SettingsError
        `pipeline` names neither built-in parameters nor a readable file of parameters.
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
