"""The help of `isoshape`: groups and whole summaries."""

import re
from importlib import import_module
from pathlib import Path
from typing import get_args

import pytest

from service import cli
from service.cli.commands import COMMANDS, Group
from tests.service.cli.conftest import Run


def test_the_table_names_every_command() -> None:
    folder = Path(cli.__file__).parent
    functions = {
        (".".join(path.relative_to(folder).with_suffix("").parts), name)
        for path in folder.rglob("*.py")
        for name in re.findall(r"^def (\w+)_command\(", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert {(command.module, name) for name, command in COMMANDS.items()} == functions


@pytest.mark.parametrize("name", COMMANDS)
def test_a_summary_is_the_first_line_of_the_docstring(name: str) -> None:
    function = getattr(import_module(f"service.cli.{COMMANDS[name].module}"), f"{name}_command")
    assert COMMANDS[name].summary == function.__doc__.splitlines()[0]
    assert len(COMMANDS[name].summary) <= 60
    assert COMMANDS[name].summary.endswith(".")


def test_help_has_every_command_in_its_group_on_one_line(run: Run) -> None:
    text = run("--help").stdout
    for group in get_args(Group):
        section = re.search(rf"^{group}:\n((?:  .*\n?)+)", text, re.MULTILINE)
        assert section is not None
        rows = [tuple(line.split(maxsplit=1)) for line in section[1].splitlines()]
        assert rows == [(name, c.summary) for name, c in COMMANDS.items() if c.group == group]
    assert max(map(len, text.splitlines())) <= 80


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help(run: Run, name: str) -> None:
    done = run(name, "--help")
    assert done.status == 0
    assert COMMANDS[name].summary in done.stdout


def test_an_unknown_command_is_told_what_it_may_be(run: Run) -> None:
    done = run("queri")
    assert done.status == 2
    assert "Did you mean 'query'?" in done.stderr
