"""The command line `isoshape`: one file a command."""

import sys


def main() -> None:
    """Run the command line."""
    # Here, because a worker process imports this package anew and needs no command.
    from service.cli.commands import COMMANDS, command_line  # noqa: PLC0415

    asked = sys.argv[1] if len(sys.argv) > 1 else ""
    command_line([asked] if asked in COMMANDS else COMMANDS)()


__all__ = ["options"]
