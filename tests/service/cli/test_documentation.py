"""The Python of README.md and docs/client.md does what the pages say."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from service.client import Client
from tests.service.cli.conftest import Run, mesh_bytes

ROOT = Path(__file__).parents[3]
ADDRESS = "http://127.0.0.1:8000"

Example = Callable[[str, int], list[str]]


@pytest.fixture
def example(archive: Client, capsys: pytest.CaptureFixture[str]) -> Example:
    """Run one Python block of a page against a running service; return the lines that it prints."""

    def run(page: str, number: int) -> list[str]:
        code = re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(), re.MULTILINE | re.DOTALL)
        exec(compile(code[number].replace(ADDRESS, archive.url), page, "exec"), {})
        return capsys.readouterr().out.splitlines()

    return run


def save_query_of_the_demo() -> None:
    Path("isoshape-data").mkdir()
    Path("isoshape-data/bird-08.ply").write_bytes(mesh_bytes("bird", 8, "ply"))


def test_the_library_of_the_readme(example: Example) -> None:
    save_query_of_the_demo()
    (line,) = example("README.md", 0)
    assert line == "1.0 100 points correspond"


def test_the_client_of_the_readme(archive: Client, example: Example) -> None:
    save_query_of_the_demo()
    (line,) = example("README.md", 1)
    assert line == "1 bird-08.ply 1.0"
    assert archive.page().total == 0


def test_the_examples_of_the_page(archive: Client, example: Example) -> None:
    Path("parts").mkdir()
    for label in ("cup", "pliers"):
        Path(f"parts/{label}.stl").write_bytes(mesh_bytes(label, 0, "stl"))
    Path("parts/empty.stl").touch()
    # The example adds its tag and its metadata to a part that is stored.
    archive.upload(Path("parts/cup.stl"))
    refused, found, pairs = example("docs/client.md", 0)
    assert refused == "empty.stl empty-file"
    assert found.startswith("1 pliers.stl 0.")
    assert pairs == "100 points correspond"
    assert [shape.metadata for shape in archive.shapes()] == [{"folder": "parts"}] * 2
    assert example("docs/client.md", 1) == ["cup.stl ['pliers.stl']", "pliers.stl ['cup.stl']"]


def test_the_options_of_a_query_are_all_on_the_page(run: Run) -> None:
    rows = re.findall(r"^\| (`--.*?) \|", (ROOT / "docs/client.md").read_text(), re.MULTILINE)
    told = {option for row in rows for option in re.findall(r"--[a-z-]+", row)}
    known = re.findall(r"^\W*(--[a-z-]+)", run("query", "--help").stdout, re.MULTILINE)
    assert told == set(known) - {"--help"}
    assert len(known) == len(set(known))
