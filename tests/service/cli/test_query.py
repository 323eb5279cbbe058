"""`isoshape query`, and which service a command talks to."""

import csv
import errno
import hashlib
import io
import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from core.io import read_mesh, write_mesh
from core.mesh.mesh import Mesh
from service import web
from service.auth.keys import digest_of
from service.cli import file_queries, service_address
from service.cli.commands import _in_one_line, plain_app
from service.cli.query import COLUMNS
from service.client import Client, ProblemError
from service.http.problem_document import Problem
from service.search import endpoints
from service.search.schemas import QueryAnswer, SearchOptions
from tests.service.cli.conftest import Run, mesh_bytes
from tests.service.html import Parsed


@pytest.fixture
def no_local_service(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever this machine runs on the default port, look where nothing listens."""
    monkeypatch.setattr(service_address, "DEFAULT_PORT", 9)


def test_table(archive: Client, cup: Path, run: Run) -> None:
    name = "[bold]a cup with :smile: and a long name"
    facts = archive.upload(cup, name=name, tags=["cup"]).shape.facts
    archive.upload(("octopus.off", mesh_bytes("octopus", 0)))
    done = run("query", cup, "--url", archive.url)
    assert done.status == 0
    lines = [re.split(" {2,}", line.strip()) for line in done.stdout.splitlines() if line.strip(" ─")]
    scores = ["cc", "ssd", "sim", "combined"]
    assert lines[0] == ["rank", "name", "likeness", *scores, "sides", "size over query", "tags"]
    assert lines[1][:6] == ["1", name, "Same part", "1.0000", "0.0000", "1.0000"]
    sides = " × ".join(f"{float(f'{side:.4g}'):g}" for side in facts.bounding_box)
    assert lines[1][7:] == [sides, "1", "cup"]
    assert lines[2][:2] == ["2", "octopus.off"]
    assert len(lines) == 3
    assert "2 of 2 stored shapes compared; sorted by combined" in done.stderr
    assert "embed" in done.stderr


def test_json_is_the_services_answer(archive: Client, cup: Path, run: Run) -> None:
    for label in ("cup", "octopus", "pliers"):
        archive.upload((f"{label}.off", mesh_bytes(label, 1)), tags=[label])
    options = ("--top-k", 2, "--rank-by", "ssd", "--json", "--url", archive.url)
    answer = QueryAnswer.model_validate(json.loads(run("query", cup, *options).stdout))
    direct = archive.query_file(cup, top_k=2, rank_by="ssd")
    assert answer.results == direct.results
    assert [result.ssd for result in answer.results] == sorted(result.ssd for result in answer.results)
    tagged = json.loads(run("query", cup, "--tag", "pliers", "--json", "--url", archive.url).stdout)
    assert [result["shape"]["name"] for result in tagged["results"]] == ["pliers.off"]


def test_every_option_of_a_search_is_one_of_the_command(run: Run) -> None:
    words = run("query", "--help").stdout.split()
    # Fields that the page asks for, and arrays, which are for programs.
    missing = {"correspondences", "embedding"}
    for name in set(SearchOptions.model_fields) - missing:
        assert f"--{name.replace('_', '-')}" in words


def test_filters(archive: Client, cup: Path, run: Run) -> None:
    mesh = read_mesh(mesh_bytes("cup", 0), "off")
    same = archive.upload(("cup.off", mesh_bytes("cup", 0)), metadata={"made": "here"}).shape
    archive.upload(("large cup.off", write_mesh(Mesh(3 * mesh.vertices, mesh.faces), "off")))
    archive.upload(("octopus.off", mesh_bytes("octopus", 0)))

    def found(*options: object) -> set[str]:
        answer = json.loads(run("query", cup, *options, "--json", "--url", archive.url).stdout)
        return {result["shape"]["name"] for result in answer["results"]}

    everything = {"cup.off", "large cup.off", "octopus.off"}
    assert found() == found("--exhaustive") == found("--scale", "ignore") == everything
    assert found("--scale", "respect", "--min-cc", 0.5) == {"cup.off"}
    assert found("--min-cc", 0.999) == everything - {"octopus.off"}
    assert found("--name", "CUP") == everything - {"octopus.off"}
    assert found("--metadata", "made=here") == {"cup.off"}
    assert found("--exclude", same.id) == found("--exclude-self") == everything - {"cup.off"}
    none = run("query", cup, "--min-cc", 1, "--name", "octopus", "--url", archive.url)
    assert none.stdout == "no compared shape has so high a cc\n"


def test_a_page_with_pictures(archive: Client, cup: Path, run: Run, tmp_path: Path) -> None:
    stored = [archive.upload((f"{label}.off", mesh_bytes(label, 1))).shape for label in ("cup", "octopus")]
    paths = [tmp_path / "one.html", tmp_path / "two.html"]
    done = run("query", cup, "--html", paths[0], "--url", archive.url)
    assert (done.status, "cup.off" in done.stdout) == (0, True)
    printed = run("query", cup, "--html", paths[1], "--json", "--url", archive.url)
    assert "correspondence" not in json.loads(printed.stdout)["results"][0]
    text = paths[0].read_bytes()
    assert text == paths[1].read_bytes()
    parsed = Parsed(text.decode())
    assert len(set(parsed.pictures)) >= 4
    assert len(parsed.pictures) == 5
    assert {"1. cup.off", "2. octopus.off", stored[0].id, hashlib.sha256(cup.read_bytes()).hexdigest()} <= {
        *parsed.texts
    }
    nowhere = run("query", cup, "--html", tmp_path / "no" / "a.html", "--url", archive.url)
    assert nowhere.status == 1
    assert nowhere.stderr.endswith("No such file or directory\n")


def test_nothing_stored(archive: Client, cup: Path, run: Run) -> None:
    done = run("query", cup, "--url", archive.url)
    assert (done.status, done.stdout) == (0, "no stored shape could be compared\n")


def test_bad_files_and_options(archive: Client, tmp_path: Path, run: Run) -> None:
    missing = run("query", tmp_path / "nothing.off", "--url", archive.url)
    assert missing.status == 1
    assert missing.stderr == f"isoshape: {tmp_path / 'nothing.off'}: No such file or directory\n"
    (tmp_path / "bad.off").write_bytes(b"OFF\n1 1 0\n")
    bad = run("query", tmp_path / "bad.off", "--url", archive.url)
    assert bad.status == 1
    assert len(bad.stderr.splitlines()) == 2
    (tmp_path / "bad.off").write_bytes(b"")
    empty = run("query", tmp_path / "bad.off", "--url", archive.url)
    assert empty.stderr.splitlines()[1] == "isoshape: The file is empty"
    assert run("query", tmp_path / "bad.off", "--rank-by", "colour").status == 2
    assert run("query", tmp_path / "bad.off", "--top-k", "0").status == 2


def test_url_goes_before_the_database(
    archive: Client, cup: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ISOSHAPE_DATABASE_URL", "sqlite:///never.sqlite3")
    monkeypatch.setenv("ISOSHAPE_URL", archive.url)
    assert run("query", cup).stderr.startswith(f"using the service at {archive.url}\n")
    assert not Path("never.sqlite3").exists()


def test_a_database_without_a_service(
    archive: Client, cup: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A service runs on the default port too: the database that was named goes before it.
    monkeypatch.setattr(service_address, "DEFAULT_PORT", int(archive.url.rpartition(":")[2]))
    monkeypatch.setenv("ISOSHAPE_DATABASE_URL", "sqlite:///own/archive.sqlite3")
    # The keys are those of a service.
    monkeypatch.setenv("ISOSHAPE_API_KEYS", digest_of("isoshape_key"))
    stored = run("ingest", cup)
    assert (stored.status, stored.stdout) == (0, "1 stored, 0 already there, 0 refused\n")
    assert stored.stderr == "using the database sqlite:///own/archive.sqlite3\n"
    found = json.loads(run("query", cup, "--json", "--html", "found.html").stdout)
    assert found["results"][0]["cc"] == pytest.approx(1.0, abs=1e-6)
    assert "1. a cup.off" in Parsed(Path("found.html").read_text(encoding="utf-8")).texts
    assert Path("own/archive.sqlite3").is_file()
    assert archive.page().total == 0


def test_a_local_service_is_found(
    archive: Client, cup: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service_address, "DEFAULT_PORT", int(archive.url.rpartition(":")[2]))
    assert run("query", cup).stderr.startswith(f"using the service at {archive.url}\n")
    assert not Path("isoshape-data").exists()


@pytest.mark.usefixtures("no_local_service")
def test_the_default_database_otherwise(cup: Path, run: Run) -> None:
    assert run("ingest", cup).status == 0
    done = run("query", cup)
    assert done.status == 0
    assert done.stderr.startswith("using the database sqlite:///isoshape-data/isoshape.sqlite3\n")
    assert Path("isoshape-data/isoshape.sqlite3").is_file()


def test_passwords_are_not_shown(cup: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ISOSHAPE_DATABASE_URL", "postgresql://me:secret@127.0.0.1:9/archive")
    done = run("query", cup)
    assert done.status in {1, 2}
    assert "secret" not in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("name", "value"),
    [("DATABASE_URL", "nonsense"), ("WORKERS", "none"), ("PIPELINE", "nowhere.json"), ("X", "1")],
)
@pytest.mark.usefixtures("no_local_service")
def test_bad_settings_are_named(
    name: str, value: str, cup: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(f"ISOSHAPE_{name}", value)
    done = run("ingest", cup)
    assert done.status == 2
    assert f"ISOSHAPE_{name}" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_columns_are_those_of_the_page() -> None:
    script = (Path(web.__file__).parent / "static" / "results.js").read_text()
    columns = script.partition("const COLUMNS = [")[2].partition("];")[0]
    assert re.findall(r'^ *\["(\w+)"', columns, re.MULTILINE) == list(COLUMNS)


def test_a_reader_that_has_enough_ends_a_command_in_silence() -> None:
    def write() -> None:
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    app = plain_app()
    app.command()(_in_one_line(write))
    done = CliRunner().invoke(app)
    assert (done.exit_code, done.output) == (1, "")


def test_a_folder_is_queried_by_batches(
    archive: Client, cup: Path, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = archive.upload(cup, name="=cup").shape
    folder = tmp_path / "folder"
    (folder / "deep").mkdir(parents=True)
    (folder / "one.off").write_bytes(cup.read_bytes())
    (folder / "deep" / "two.off").write_bytes(mesh_bytes("octopus", 0))
    (folder / "bad.off").write_bytes(b"no mesh")
    done = run("query", folder, "--csv", "--top-k", "1", "--url", archive.url)
    assert (done.status, "2 of 3 files queried" in done.stderr, "bad.off: " in done.stderr) == (1, True, True)
    rows = {Path(row["file"]).name: row for row in csv.DictReader(io.StringIO(done.stdout))}
    assert set(rows) == {"one.off", "two.off"}
    assert (rows["one.off"]["id"], rows["one.off"]["name"]) == (stored.id, "'=cup")
    assert (rows["one.off"]["likeness"], float(rows["one.off"]["cc"])) == ("same", pytest.approx(1.0))
    sides = [float(rows["one.off"][side]) for side in ("length", "width", "height")]
    assert sides == stored.facts.bounding_box
    assert (rows["one.off"]["unit"], rows["one.off"]["difference"]) == ("", "")
    assert float(rows["two.off"]["cc"]) < 0.999
    # A batch that is refused is sent file by file.
    monkeypatch.setattr(endpoints.QUERIES, "_most_files", 1)
    again = run("query", folder, "--csv", "--top-k", "1", "--url", archive.url)
    assert (again.status, again.stdout, again.stderr) == (1, done.stdout, done.stderr)
    assert run("query", folder, "--csv", "--json", "--url", archive.url).status == 2


def test_batches_have_bounds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(file_queries, "BATCH_FILES", 3)
    monkeypatch.setattr(file_queries, "BATCH_BYTES", 10)
    paths = []
    for number, size in enumerate((20, 4, 6, 1, 1, 1, 1, 10, 1)):
        paths.append(tmp_path / str(number))
        paths[-1].write_bytes(bytes(size))
    batches = [[int(path.name) for path in batch] for batch in file_queries.batches(paths)]
    assert batches == [[0], [1, 2], [3, 4, 5], [6], [7], [8]]


@pytest.mark.parametrize(("kind", "times"), [("not-ready", 1), ("storage-unavailable", 1), ("time-limit", 4)])
def test_a_service_that_cannot_work_is_asked_once_for_a_batch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, times: int
) -> None:
    asked = []

    def refuse(*_arguments: object) -> None:
        asked.append(kind)
        raise ProblemError(Problem.answering("id", kind, "later"))

    monkeypatch.setattr(Client, "query_batch", refuse)
    paths = [tmp_path / name for name in "abc"]
    for path in paths:
        path.touch()
    with Client("http://127.0.0.1:1") as client:
        reasons = [reason for _, reason in file_queries.answers(client, paths)]
    assert len(asked) == times
    assert [str(reason).rpartition(": ")[2] for reason in reasons] == ["later"] * 3
