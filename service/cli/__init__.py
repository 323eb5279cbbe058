"""The command line: words typed in, calls to a service or an archive and printed results out.

One file a command; the research commands are in `service.cli.evaluation`.
"""


def main() -> None:
    """Run the command line."""
    # Here, because a worker process imports this package anew and needs no command.
    from service.cli.commands import command_line  # noqa: PLC0415

    command_line()()
