"""The commands of `isoshape`, and how each says what went wrong."""

from collections.abc import Callable, Collection
from concurrent.futures import BrokenExecutor
from functools import wraps
from importlib import import_module
from typing import ParamSpec

import typer

from core.errors import CoreError
from service.client import ClientError
from service.console import fail
from service.datasets import CollectionError
from service.errors import ArchiveError, ServiceError
from service.server.uvicorn_server import PortError, StartError
from service.settings import SettingsError

COMMANDS = (
    "serve",
    "demo",
    "ingest",
    "query",
    "duplicates",
    "collections",
    "evaluate",
    "calibrate",
    "ablation",
    "table2",
    "classify",
    "figures",
    "correspondence",
    "sampling",
    "robustness",
    "benchmark",
    "check",
    "backup",
    "restore",
    "copy",
    "reembed",
    "key",
    "openapi",
)
"""Each is the function `command` of the module of its name, in `studies` where `STUDIES` has it."""

STUDIES = frozenset(
    {
        "ablation",
        "benchmark",
        "calibrate",
        "classify",
        "correspondence",
        "evaluate",
        "figures",
        "robustness",
        "sampling",
        "table2",
    }
)

Arguments = ParamSpec("Arguments")


def _in_one_line(command: Callable[Arguments, None]) -> Callable[Arguments, None]:
    """The command, saying in one line what went wrong where that is no fault of the program."""

    @wraps(command)
    def wrapped(*args: Arguments.args, **options: Arguments.kwargs) -> None:
        try:
            command(*args, **options)
        except (PortError, SettingsError) as error:
            fail(str(error), status=2)
        except (ArchiveError, ClientError, CollectionError, CoreError, ServiceError, StartError) as error:
            fail(str(error))
        except BrokenExecutor:
            fail("a worker process died; there may be too little memory for so many")
        except OSError as error:
            name = f"{error.filename}: " if error.filename is not None else ""
            fail(f"{name}{error.strerror or error}")

    return wrapped


def command_line(names: Collection[str] = COMMANDS) -> typer.Typer:
    """The command line with these commands; the modules of others are not imported."""
    app = typer.Typer(
        help="Finds, among stored 3D shapes, those most like a given one, whatever their pose.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        add_completion=False,
    )
    # With a callback a single command is still called by its name.
    app.callback()(_nothing)
    for name in names:
        folder = "service.cli.studies" if name in STUDIES else "service.cli"
        app.command(name)(_in_one_line(import_module(f"{folder}.{name}").command))
    return app


def _nothing() -> None:
    pass
