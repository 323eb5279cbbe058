"""`isoshape ingest --url`: into a service that is busy and asks for a key, and into a database."""

from itertools import count
from pathlib import Path

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from service.app import create_app
from service.auth.keys import digest_of, new_key
from service.server.uvicorn_server import in_thread
from service.settings import Settings
from tests.service.cli.conftest import CLASSES, POSES, Run

TOTAL = len(CLASSES) * POSES


class BusyProxy:
    """A proxy that has every second upload wait, in its own words."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._turn = count()
        self.refused: list[int] = []

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and (scope["method"], scope["path"]) == ("POST", "/shapes"):
            turn = next(self._turn)
            if turn % 2 == 0:
                status = (429, 503)[turn // 2 % 2]
                self.refused.append(status)
                await PlainTextResponse("later", status, {"retry-after": "0"})(scope, receive, send)
                return
        await self._app(scope, receive, send)


def test_a_busy_service_behind_a_proxy_and_a_key(collection: Path, tmp_path: Path, run: Run) -> None:
    key = new_key()
    database_url = f"sqlite:///{tmp_path}/served.sqlite3"
    settings = Settings(database_url=database_url, workers=1, log_level="error", api_keys=(digest_of(key),))
    proxy = BusyProxy(create_app(settings))
    with in_thread(proxy, key) as client:
        # One at a time: with several, one upload could have every turn that is refused.
        asked = ("ingest", collection, "--url", client.url, "--at-once", 1)
        done = run(*asked, "--key", key)
        assert (done.status, done.stdout) == (0, f"{TOTAL} stored, 0 already there, 0 refused\n")
        assert set(proxy.refused) == {429, 503}
        assert run(*asked, "--key", key).stdout == f"0 stored, {TOTAL} already there, 0 refused\n"
        for arguments in (asked, (*asked, "--key", new_key())):
            stranger = run(*arguments)
            assert stranger.status == 1
            assert stranger.stdout == ""
            assert len(stranger.stderr.splitlines()) == 1
        assert client.page().total == TOTAL


def test_an_address_of_nothing_that_is_known(collection: Path, run: Run) -> None:
    for url in ("mysql://localhost/archive", "ftp://localhost", "sqlite://"):
        done = run("ingest", collection, "--url", url)
        assert done.status == 2
        assert done.stderr.startswith("isoshape: --url: ")
