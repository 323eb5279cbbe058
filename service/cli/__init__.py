"""The command line `isoshape`: one file a command."""

from collections.abc import Callable
from concurrent.futures import BrokenExecutor
from functools import wraps
from typing import ParamSpec

import typer

from core.errors import CoreError
from service.cli import (
    ablation,
    calibrate,
    classify,
    correspondence,
    demo,
    evaluate,
    figures,
    ingest,
    key,
    openapi,
    query,
    robustness,
    sampling,
    serve,
    table2,
)
from service.cli.console import fail
from service.cli.server import PortError, StartError
from service.client import ClientError
from service.collections import CollectionError
from service.settings import SettingsError

Arguments = ParamSpec("Arguments")


def _in_one_line(command: Callable[Arguments, None]) -> Callable[Arguments, None]:
    """The command, saying in one line what went wrong where that is no fault of the program."""

    @wraps(command)
    def wrapped(*args: Arguments.args, **options: Arguments.kwargs) -> None:
        try:
            command(*args, **options)
        except (PortError, SettingsError) as error:
            fail(str(error), status=2)
        except (ClientError, CollectionError, CoreError, StartError) as error:
            fail(str(error))
        except BrokenExecutor:
            fail("a worker process died; there may be too little memory for so many")
        except OSError as error:
            name = f"{error.filename}: " if error.filename is not None else ""
            fail(f"{name}{error.strerror or error}")

    return wrapped


app = typer.Typer(
    help="Finds, among stored 3D shapes, those most like a given one, whatever their pose.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    add_completion=False,
)
app.command("serve")(_in_one_line(serve.command))
app.command("demo")(_in_one_line(demo.command))
app.command("ingest")(_in_one_line(ingest.command))
app.command("query")(_in_one_line(query.command))
app.command("evaluate")(_in_one_line(evaluate.command))
app.command("calibrate")(_in_one_line(calibrate.command))
app.command("ablation")(_in_one_line(ablation.command))
app.command("table2")(_in_one_line(table2.command))
app.command("classify")(_in_one_line(classify.command))
app.command("figures")(_in_one_line(figures.command))
app.command("correspondence")(_in_one_line(correspondence.command))
app.command("sampling")(_in_one_line(sampling.command))
app.command("robustness")(_in_one_line(robustness.command))
app.command("key")(_in_one_line(key.command))
app.command("openapi")(_in_one_line(openapi.command))


def main() -> None:
    """Run the command line."""
    app()
