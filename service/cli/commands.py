"""The commands of `isoshape`, and the group that imports a command when it is run.

The command NAME is the function `NAME_command` of its module. The summary is the first line of the function's
docstring. It stands in the table too, so that `isoshape --help` imports no command.
"""

from collections.abc import Callable
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass
from functools import partial, wraps
from importlib import import_module
from typing import TYPE_CHECKING, Literal, ParamSpec, get_args

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from core.errors import CoreError
from service.errors import ExpectedError, ServiceError, plain_text

Group = Literal["Use", "Archive", "Research"]


@dataclass(frozen=True)
class Command:
    """A command: the group that lists it, its summary, and its module in `service.cli`."""

    group: Group
    summary: str
    module: str


def _evaluation(summary: str, module: str) -> Command:
    return Command("Research", summary, f"evaluation.{module}")


COMMANDS = {
    "serve": Command("Use", "Serve the archive over HTTP until Ctrl-C.", "serve"),
    "demo": Command("Use", "Make shapes, store them and query them with unseen poses.", "demo"),
    "ingest": Command("Use", "Store mesh files, folders of meshes and archives.", "ingest"),
    "library": Command("Use", "List, add, scan and remove folders that stay in place.", "library"),
    "query": Command("Use", "Find the stored shapes most similar to a mesh file.", "query"),
    "list": Command("Use", "List stored shapes, or deleted ones.", "shapes"),
    "show": Command("Use", "Show all that is stored about shapes.", "shapes"),
    "tag": Command("Use", "Add tags to shapes, and remove tags.", "shapes"),
    "delete": Command("Use", "Delete shapes.", "shapes"),
    "restore": Command("Use", "Restore deleted shapes.", "shapes"),
    "compare": Command("Use", "Compare two shapes, vertex by vertex with --out.", "compare"),
    "duplicates": Command("Use", "Find groups of near-identical stored shapes.", "compare"),
    "mcp": Command("Use", "Offer the archive to programs over MCP.", "mcp"),
    "collections": Command("Use", "List, create and delete collections of shapes.", "access"),
    "compile": Command("Use", "Compile the kernels for this processor, once.", "serve"),
    "key": Command("Use", "Make an API key and print it with its SHA-256.", "access"),
    "openapi": Command("Use", "Write the OpenAPI document of the service.", "serve"),
    "check": Command("Archive", "Check every file, reference and embedding of an archive.", "archives"),
    "backup": Command("Archive", "Copy the archive into a file while services use it.", "archives"),
    "recover": Command("Archive", "Replace the archive by a backup.", "archives"),
    "copy": Command("Archive", "Copy an archive between SQLite and PostgreSQL.", "archives"),
    "reembed": Command("Archive", "Embed every stored shape by another pipeline.", "archives"),
    "evaluate": _evaluation("Measure retrieval on a labelled collection.", "evaluate"),
    "classify": _evaluation("Classify each shape by its nearest neighbour.", "classify"),
    "table2": _evaluation("Measure the paper's Table 2, category by category.", "table2"),
    "correspondence": _evaluation("Measure correspondences against the true ones.", "correspondence"),
    "calibrate": _evaluation("Fit the class probability to labelled collections.", "calibrate"),
    "benchmark": _evaluation("Measure the time and memory of embedding and matching.", "benchmark"),
}
"""Each command by its name, in the order of the help."""


if TYPE_CHECKING:
    from typer._click import Context, HelpFormatter

Arguments = ParamSpec("Arguments")

plain_app = partial(typer.Typer, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


class CommandGroup(TyperGroup):
    """Lists the commands by the table alone, in groups, and imports the module of a command that is run."""

    def get_command(self, ctx: "Context", cmd_name: str) -> TyperCommand | None:
        """Import a command."""
        return _imported(cmd_name) if cmd_name in self.commands else None

    def invoke(self, ctx: "Context") -> object:
        """Run a command, or tell what is wrong in its options."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            error.message = plain_text(error.message)
            raise

    def format_commands(self, ctx: "Context", formatter: "HelpFormatter") -> None:
        """Write a section a group."""
        for group in get_args(Group):
            with formatter.section(group):
                formatter.write_dl(
                    [(name, command.summary) for name, command in COMMANDS.items() if command.group == group]
                )


def command_line() -> typer.Typer:
    """Return the command line with all commands, none of them imported."""
    app = plain_app(
        cls=CommandGroup,
        help="Find the stored 3D shapes most similar to a given one, in any pose.",
        no_args_is_help=True,
    )
    # With a callback a single command is still called by its name.
    app.callback()(_nothing)
    for name, command in COMMANDS.items():
        app.command(name, help=command.summary, rich_help_panel=command.group)(_nothing)
    return app


def _imported(name: str) -> TyperCommand:
    app = plain_app()
    module = import_module(f"service.cli.{COMMANDS[name].module}")
    app.command(name)(_in_one_line(getattr(module, f"{name}_command")))
    command = get_command(app)
    assert isinstance(command, TyperCommand)
    return command


def _in_one_line(command: Callable[Arguments, None]) -> Callable[Arguments, None]:
    """Return the command; an error that is no fault of the program ends it with one line."""

    @wraps(command)
    def wrapped(*args: Arguments.args, **options: Arguments.kwargs) -> None:
        # Here, so that the help does not wait for the terminal's formatting.
        from service.console import fail  # noqa: PLC0415

        try:
            command(*args, **options)
        except ExpectedError as error:
            fail(str(error), status=error.status)
        except (CoreError, ServiceError) as error:
            fail(str(error))
        except BrokenExecutor:
            fail("a worker process died; there may be too little memory for so many")
        except BrokenPipeError:
            # The reader, such as head, has enough; the command line ends without a word.
            raise
        except OSError as error:
            name = f"{error.filename}: " if error.filename is not None else ""
            fail(f"{name}{error.strerror or error}")

    return wrapped


def _nothing() -> None:
    pass
