"""The command line `isoshape`: a group that imports a command when it is run."""

from collections.abc import Callable
from concurrent.futures import BrokenExecutor
from functools import partial, wraps
from importlib import import_module
from typing import TYPE_CHECKING, ParamSpec, get_args

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from core.errors import CoreError
from service.cli.command_table import COMMANDS, Group
from service.errors import ExpectedError, ServiceError

if TYPE_CHECKING:
    from typer._click import Context, HelpFormatter

Arguments = ParamSpec("Arguments")

plain_app = partial(typer.Typer, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


class CommandGroup(TyperGroup):
    """Lists the commands by the table alone, in groups, and imports the module of a command that is run."""

    def get_command(self, ctx: "Context", cmd_name: str) -> TyperCommand | None:
        """Import a command."""
        return _imported(cmd_name) if cmd_name in self.commands else None

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
        except OSError as error:
            name = f"{error.filename}: " if error.filename is not None else ""
            fail(f"{name}{error.strerror or error}")

    return wrapped


def _nothing() -> None:
    pass
