"""Keys on the command line: made, asked for, and sent."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.app import create_app
from service.auth.keys import digest_of
from service.cli import demo, service_address
from service.cli.serve import warn_of_python
from service.client import Client, ClientError, ProblemError
from service.server.process import is_loopback
from service.server.uvicorn_server import in_thread
from service.settings import Settings
from tests.service.cli.conftest import CLASSES, Run, child_in_thread
from tests.service.cli.test_server import free_port

FULL, READ = "isoshape_full-key", "isoshape_read-key"


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    """A service with keys, and a client that may do everything."""
    settings = Settings(
        database_url=f"sqlite:///{tmp_path_factory.mktemp('locked')}/archive.sqlite3",
        workers=1,
        log_level="error",
        api_keys=(digest_of(FULL),),
        read_keys=(digest_of(READ),),
    )
    with in_thread(create_app(settings), FULL) as client:
        yield client


def test_a_key_and_its_digest_are_printed(run: Run) -> None:
    printed = run("key")
    found = re.fullmatch(r"key     (\S+)\nsha256  ([0-9a-f]{64})\n", printed.stdout)
    assert (printed.status, printed.stderr) == (0, "")
    assert found
    assert digest_of(found[1]) == found[2]
    assert run("key").stdout != printed.stdout
    assert Settings(api_keys=found[2]).api_keys == (found[2],)


@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_no_public_address_without_a_key(run: Run, monkeypatch: pytest.MonkeyPatch, host: str) -> None:
    for arguments in (("serve", "--host", host, "--port", 0), ("serve", "--port", 0)):
        monkeypatch.setenv("ISOSHAPE_HOST", host)
        done = run(*arguments)
        assert done.status == 2
        assert done.stderr.startswith(f"isoshape: {host} can be reached from other machines")
        assert "ISOSHAPE_API_KEYS" in done.stderr
        assert len(done.stderr.splitlines()) == 1
    assert not Path("isoshape-data").exists()


@pytest.mark.parametrize("name", ["API_KEYS", "READ_KEYS"])
def test_a_public_address_with_a_key(run: Run, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr("service.server.uvicorn_server.run", lambda app, bound, seconds: None)
    monkeypatch.setenv(f"ISOSHAPE_{name}", "0" * 64)
    done = run("serve", "--host", "0.0.0.0", "--port", 0)
    assert done.status == 0
    assert "Isoshape starts on http://0.0." in done.stderr


def test_loopback_addresses() -> None:
    assert all(map(is_loopback, ["127.0.0.1", "127.8.9.1", "::1"]))
    assert not any(map(is_loopback, ["0.0.0.0", "::", "192.0.2.1", "2001:db8::1"]))


def test_the_client_sends_its_key(locked: Client) -> None:
    assert locked.version().pipeline == "default"
    with Client(locked.url) as keyless, pytest.raises(ProblemError) as refused:
        keyless.version()
    assert refused.value.kind == "unauthorized"
    with Client(locked.url, key=f" {READ}\n") as reader:
        assert reader.page().total >= 0
        with pytest.raises(ProblemError) as refused:
            reader.delete("x")
    assert refused.value.kind == "forbidden"


@pytest.mark.parametrize("key", ["a\nb", "schlüssel"])
def test_a_key_that_cannot_be_sent(key: str) -> None:
    with pytest.raises(ClientError, match="characters"):
        Client("http://127.0.0.1:9", key=key)


def test_commands_send_a_key(locked: Client, cup: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    for command in (("ingest", cup), ("query", cup)):
        for key in ((), ("--key", "wrong")):
            done = run(*command, "--url", locked.url, *key)
            assert (done.status, done.stdout) == (1, "")
            assert done.stderr.startswith("isoshape: A key of this service is needed: ")
    stored = run("ingest", cup, "--url", locked.url, "--key", FULL)
    assert (stored.status, stored.stdout) == (0, "1 stored, 0 already there, 0 refused\n")
    monkeypatch.setenv("ISOSHAPE_API_KEY", READ)
    found = run("query", cup, "--url", locked.url, "--json")
    assert json.loads(found.stdout)["results"][0]["shape"]["name"] == "a cup.off"
    refused = run("ingest", cup, "--url", locked.url)
    assert refused.status == 1
    assert "forbidden" in refused.stderr


def test_a_local_service_that_wants_a_key_is_not_passed_by(
    locked: Client, cup: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service_address, "DEFAULT_PORT", int(locked.url.rpartition(":")[2]))
    done = run("query", cup)
    assert (done.status, done.stdout) == (1, "")
    assert "A key of this service is needed" in done.stderr
    assert not Path("isoshape-data").exists()
    assert run("query", cup, "--key", READ).status == 0


def test_the_demo_on_a_machine_with_keys_needs_one(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "CLASSES", CLASSES[:1])
    monkeypatch.setattr(demo, "POSES", 2)
    monkeypatch.setattr(demo, "ChildService", child_in_thread)
    monkeypatch.setenv("ISOSHAPE_API_KEYS", digest_of(FULL))
    keyless = run("demo", "--check", "--port", free_port())
    assert keyless.status == 1
    assert "A key of this service is needed" in keyless.stderr


def test_the_demo_shows_how_to_send_the_key_and_not_the_key(capsys: pytest.CaptureFixture[str]) -> None:
    class Ended:
        url = "http://127.0.0.1:1"

        def wait(self) -> int:
            raise KeyboardInterrupt

    demo._offer(Ended(), Path("a.ply"), needs_key=True)  # type: ignore[arg-type]
    demo._offer(Ended(), Path("a.ply"), needs_key=False)  # type: ignore[arg-type]
    first, second = capsys.readouterr().out.splitlines()
    assert first == 'curl -H "X-API-Key: $ISOSHAPE_API_KEY" -F file=@a.ply http://127.0.0.1:1/query'
    assert second == "curl -F file=@a.ply http://127.0.0.1:1/query"


@pytest.mark.parametrize(
    ("version", "warned"),
    [((3, 11, 9), True), ((3, 11, 10), False), ((3, 12, 5), True), ((3, 12, 6), False), ((3, 13, 0), False)],
)
def test_a_python_with_known_holes_is_named(
    version: tuple[int, int, int], warned: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    warn_of_python(version)
    said = capsys.readouterr().err
    assert said.startswith(f"Warning: Python {'.'.join(map(str, version))} ") == warned
    assert bool(said) == warned
