"""Commands that work in a collection."""

import json
from pathlib import Path

import pytest

from service.auth.keys import KeyEntry, digest_of
from service.client import Client, ClientError
from service.settings import Settings
from tests.service.cli.conftest import POSES, Run, mesh_bytes


def test_a_database_with_two_collections(collection: Path, tmp_path: Path, run: Run) -> None:
    path, cups = tmp_path / "own.sqlite3", collection / "cup"
    at = ("--url", f"sqlite:///{path}")
    made = run("collections", "--create", "castings", *at)
    assert (made.status, counts(made.stdout)) == (0, {"castings": "0", "default": "0"})
    stored = run("ingest", cups, "--collection", "castings", *at)
    assert (stored.status, stored.stdout) == (0, f"{POSES} stored, 0 already there, 0 refused\n")
    assert stored.stderr == f"using the database {at[1]}\n"
    assert not Path("isoshape-data").exists()
    assert run("ingest", cups / "cup-0.off", *at).stdout == "1 stored, 0 already there, 0 refused\n"
    # Commands about files cover all collections.
    checked = run("check", path, "--json")
    assert json.loads(checked.stdout)["shapes"] == POSES + 1
    copied = run("copy", path, tmp_path / "copy.sqlite3")
    assert copied.stdout.startswith(f"{POSES + 1} shapes on {POSES} files")
    listed = run("collections", "--url", f"sqlite:///{tmp_path}/copy.sqlite3")
    assert counts(listed.stdout) == {"castings": str(POSES), "default": "1"}


def test_a_service_with_two_collections(archive: Client, collection: Path, run: Run) -> None:
    at, cups = ("--url", archive.url), collection / "cup"
    cup = cups / "cup-0.off"
    assert run("collections", "--create", "cast", *at).status == 0
    assert run("ingest", cups, "--collection", "cast", *at).status == 0
    assert run("ingest", cup, *at).stdout == "1 stored, 0 already there, 0 refused\n"
    for named, many in (("cast", POSES), ("default", 1)):
        asked = run("query", cup, "--json", "--collection", named, *at)
        assert json.loads(asked.stdout)["stored"] == many
    found = run("duplicates", "--csv", *at)
    assert "0 of 1 shape in" in found.stderr
    listed = run("collections", "--delete", "cast", *at)
    assert (listed.status, listed.stdout) == (1, "")
    assert "not empty" in listed.stderr.splitlines()[-1]
    with Client(archive.url, collection="cast") as cast:
        for shape in list(cast.shapes()):
            cast.delete(shape.id, permanent=True)
    deleted = run("collections", "--delete", "cast", *at)
    assert (deleted.status, counts(deleted.stdout)) == (0, {"default": "1"})


def counts(table: str) -> dict[str, str]:
    """The rows of a table under its head."""
    return dict(line.split() for line in table.splitlines()[3:] if line.strip())


def test_a_collection_that_is_not_there_is_said_once(
    archive: Client, cup: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ISOSHAPE_COLLECTION", "misspelt")
    for command in (("ingest", cup), ("query", cup), ("duplicates",)):
        done = run(*command, "--url", archive.url)
        assert (done.status, done.stdout) == (1, "")
        assert done.stderr.splitlines()[-1] == (
            "isoshape: there is no collection 'misspelt'; `isoshape collections --create misspelt` makes one"
        )
        assert "PUT" not in done.stderr
    assert archive.page().total == 0
    with pytest.raises(ClientError, match="'a b'"):
        Client(archive.url, collection="a b")


def test_clients_of_two_collections(archive: Client) -> None:
    archive.create_collection("other")
    with Client(archive.url, collection="other") as other:
        shape = other.upload(("cup.off", mesh_bytes("cup", 0))).shape
        assert [one.id for one in other.shapes()] == [shape.id]
        assert list(archive.shapes()) == []
        counts = {one.name: one.shapes for one in archive.collections().collections}
        assert counts == {"default": 0, "other": 1}
        other.delete(shape.id, permanent=True)
    archive.delete_collection("other")
    assert [one.name for one in archive.collections().collections] == ["default"]


def test_a_key_that_is_limited(run: Run) -> None:
    printed = run("key", "--collection", "b", "--collection", "a").stdout.split()
    entry = KeyEntry.read(printed[3])
    assert entry == KeyEntry(digest_of(printed[1]), frozenset({"a", "b"}))
    assert Settings(api_keys=printed[3]).api_keys == (printed[3],)
    wrong = run("key", "--collection", "A")
    assert (wrong.status, wrong.stdout) == (2, "")
