"""Commands that only talk to a service import neither compiled code nor the database."""

import subprocess
import sys
from pathlib import Path

from service.cli.commands import COMMANDS
from service.client import Client

DRAWING = {"rich", "pygments", "click"}
HEAVY = {"numba", "llvmlite", "sqlalchemy", "scipy", "numpy", "fastapi", "starlette", "uvicorn", "trimesh"}

SCRIPT = """
import sys
from service.cli import main
sys.argv[0] = "isoshape"
try:
    main()
finally:
    print("imported:", *sys.modules, file=sys.stderr)
"""


def imported_by(*arguments: object) -> set[str]:
    """The modules that a command has imported at its end, in a process of its own."""
    command = [sys.executable, "-c", SCRIPT, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stderr.splitlines()[-1].removeprefix("imported:").split())


def test_a_command_on_a_service_is_light_and_waits_for_rich_only_for_a_table(
    archive: Client, cup: Path
) -> None:
    for draws, arguments in (
        (True, ("ingest", cup)),
        (True, ("query", cup)),
        (False, ("query", cup, "--json")),
        (True, ("duplicates",)),
        (True, ("collections",)),
        (False, ("list", "--json")),
        (False, ("show", cup.name)),
        (False, ("tag", cup.name, "--add", "x")),
    ):
        imported = imported_by(*arguments, "--url", archive.url)
        assert {"typer", f"service.cli.{COMMANDS[arguments[0]].module}"} <= imported
        assert imported & HEAVY == set(), arguments
        assert draws or imported & DRAWING == set(), arguments
    assert imported_by("key") & HEAVY == set()
    assert [shape.name for shape in archive.shapes()] == ["a cup.off"]


def test_help_imports_no_command() -> None:
    imported = imported_by("--help")
    assert "typer" in imported
    assert imported & (HEAVY | {"pydantic", "httpx"}) == set()
    ours = {name for name in imported if name.split(".")[0] in {"core", "service"}}
    folders = {name.rpartition(".")[0] for name in ours}
    assert ours - folders == {"core.errors", "service.cli.commands", "service.errors"}


def test_the_library_and_the_client_are_light_until_they_are_used() -> None:
    script = "import sys, core, service.client; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) & HEAVY == set()


def test_a_database_is_reached_by_the_whole_service(cup: Path, tmp_path: Path) -> None:
    imported = imported_by("ingest", cup, "--url", f"sqlite:///{tmp_path}/archive.sqlite3")
    assert {"sqlalchemy", "fastapi", "uvicorn"} <= imported
