"""The command line: words typed in, calls to a service or an archive and printed results out.

One file a command; the research commands are in `service.cli.evaluation`.
"""

import sys
from io import TextIOWrapper


def main() -> None:
    """Run the command line."""
    # The names of files may be no text.
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    # httpx is imported without its own command line, which imports click and pygments: 0.1 s.
    sys.modules.setdefault("httpx._main", None)  # type: ignore[arg-type]
    # Here, because a worker process imports this package anew and needs no command.
    from service.cli.commands import command_line  # noqa: PLC0415

    command_line()()
