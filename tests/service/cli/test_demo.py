"""`isoshape demo`, with a smaller gallery, and `isoshape openapi`."""

import json
import subprocess
from pathlib import Path

import pytest
from PIL import Image

from service.auth.keys import digest_of
from service.cli import demo
from service.report import SIZE
from tests.gallery import make_shape
from tests.service.cli.conftest import CLASSES, Run, child_in_thread
from tests.service.cli.test_server import free_port
from tests.service.support import document


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "CLASSES", CLASSES)
    monkeypatch.setattr(demo, "POSES", 2)
    monkeypatch.setattr(demo, "make_shape", make_shape)


@pytest.mark.usefixtures("small")
def test_check_then_again_with_another_gallery(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    done = run("demo", "--check", "--port", free_port(), "--picture", "answers.png")
    with Image.open("answers.png") as picture:
        # The octopus and three answers; the other classes have no row.
        assert picture.size == (4 * SIZE, SIZE + demo.CAPTION_PIXELS)
        assert all(low < high for low, high in picture.getextrema())
    assert (done.status, done.stderr.splitlines()[-1]) == (
        0,
        "3 of 3 first neighbours are of the query's class",
    )
    rows = [line.split() for line in done.stdout.splitlines()]
    first = [row for row in rows if len(row) == 7 and row[1] == "1"]
    assert [row[0] for row in first] == [f"{label}-02.ply" for label in CLASSES]
    assert [(row[2].rpartition("-")[0], row[6]) for row in first] == [(label, "same") for label in CLASSES]
    assert len([row for row in rows if row and row[-1] in {"same", "other"}]) == 9
    assert Path("isoshape-data/demo.sqlite3").is_file()

    monkeypatch.setattr(demo, "ChildService", child_in_thread)
    # The same gallery again, with a key: a shape of each class is made to compare it, and nothing is stored.
    made: list[tuple[str, int]] = []
    monkeypatch.setattr(
        demo, "make_shape", lambda label, pose: made.append((label, pose)) or make_shape(label, pose)
    )
    with monkeypatch.context() as patch:
        patch.setenv("ISOSHAPE_API_KEYS", digest_of("isoshape_key"))
        again = run("demo", "--check", "--port", free_port(), "--key", "isoshape_key")
    assert (again.status, again.stdout) == (0, done.stdout)
    assert sorted(made) == sorted((label, pose) for label in CLASSES for pose in (0, demo.POSES))

    # A gallery of fewer poses, whose query for a cup is a pair of pliers: what is made no more is dropped.
    shape = demo._shape

    def misnamed(label: str, pose: int) -> tuple[str, bytes]:
        return shape("pliers", pose) if (label, pose) == ("cup", 1) else shape(label, pose)

    monkeypatch.setattr(demo, "_shape", misnamed)
    monkeypatch.setattr(demo, "POSES", 1)
    done = run("demo", "--check", "--port", free_port())
    assert done.status == 1
    assert done.stderr.splitlines()[-1].endswith("the first neighbour is of another class for pliers-01.ply")
    assert done.stdout.count("-01.ply") == 3


def test_openapi_to_a_file_and_to_standard_output(run: Run) -> None:
    assert run("openapi").status == 0
    written = Path("openapi/openapi.json").read_text(encoding="utf-8")
    assert json.loads(written) == document()
    assert run("openapi", "--output", "-").stdout == written


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("stage", ["bring_up", "wait_until_ready", "_store"])
def test_ctrl_c_ends_it_without_an_error_at_any_stage(
    stage: str, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    if stage == "_store":
        monkeypatch.setattr(demo, "ChildService", child_in_thread)
    monkeypatch.setattr(demo, stage, interrupted)
    done = run("demo", "--port", free_port())
    assert (done.status, done.stderr.splitlines()[-1]) == (0, "stopped")


def test_make_demo_takes_a_port() -> None:
    root = Path(__file__).parents[3]
    for given, expected in (([], False), (["PORT=8123"], True)):
        command = ["make", "--dry-run", "--no-print-directory", "-C", str(root), "demo", *given]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        assert ("isoshape demo  --port 8123" in done.stdout) == expected
