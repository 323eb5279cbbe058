"""Two server processes on one archive."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest
from typer.testing import CliRunner

from service.cli.commands import command_line
from service.storage.sqlite import ServingLock, path_of
from tests.service.engines import on_postgresql, url_in
from tests.service.processes import server
from tests.service.support import query, serving, settings_in, small_file, upload

WRITERS = 8
TURNS = 2


@on_postgresql
def test_two_services_see_each_others_writes_and_many_writers_on_them_lose_nothing(tmp_path: Path) -> None:
    settings = {"ISOSHAPE_LOCK_SECONDS": "60"}
    with server(tmp_path, **settings) as (_, one), server(tmp_path, **settings) as (_, other):
        clients = (one, other)
        for number in range(4):
            there, here = (one, other) if number % 2 else (other, one)
            shape = upload(here, small_file(number), f"{number}.off").json()
            answer = query(there, small_file(number), top_k=1).json()
            assert answer["results"][0]["shape"]["id"] == shape["id"]
            assert answer["stored"] == number + 1
        assert one.delete(f"/shapes/{shape['id']}").status_code == 204
        answer = query(other, small_file(number), top_k=10).json()
        assert answer["compared"] == answer["stored"] == 3
        assert shape["id"] not in {result["shape"]["id"] for result in answer["results"]}
        for result in answer["results"]:
            assert other.delete(f"/shapes/{result['shape']['id']}").status_code == 204

        def done(answer: httpx.Response, *statuses: int) -> httpx.Response:
            assert answer.status_code in statuses, answer.text
            return answer

        def write(writer: int) -> tuple[bool, dict[str, int]]:
            """Some shapes, each on bytes that others store too; the first of them deleted again."""
            client = clients[writer % 2]
            made: dict[str, int] = {}
            was_first = done(upload(client, small_file(0), "common.off"), 200, 201).status_code == 201
            for turn in range(TURNS):
                data = small_file((writer + turn) % 5)
                shape = done(upload(client, data, f"{writer} {turn}.off"), 201).json()
                made[shape["id"]] = turn
                address = f"/shapes/{shape['id']}"
                done(client.patch(address, json={"metadata": {"writer": writer, "turn": turn}}), 200)
            done(client.delete(f"/shapes/{next(iter(made))}"), 204)
            return was_first, dict(list(made.items())[1:])

        with ThreadPoolExecutor(WRITERS) as pool:
            outcomes = list(pool.map(write, range(WRITERS)))
        assert sum(was_first for was_first, _ in outcomes) == 1
        expected = {
            shape_id: {"writer": writer, "turn": turn}
            for writer, (_, made) in enumerate(outcomes)
            for shape_id, turn in made.items()
        }
        for client in clients:
            shapes = client.get("/shapes", params={"limit": 500}).json()["shapes"]
            assert {
                each["id"]: each["metadata"] for each in shapes if each["name"] != "common.off"
            } == expected
            assert len(shapes) == len(expected) + 1
            answer = query(client, small_file(9), top_k=100).json()
            assert answer["compared"] == answer["stored"] == len(shapes)
            assert {each["shape"]["id"] for each in answer["results"]} == {each["id"] for each in shapes}


def test_a_second_service_on_an_sqlite_archive_is_refused_unless_it_is_told_to_share(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[object] = []
    monkeypatch.setattr("service.server.uvicorn_server.run", lambda app, *_: begun.append(app))
    serve, environment = ["serve", "--port", "0"], {"ISOSHAPE_DATABASE_URL": url_in(tmp_path)}
    with server(tmp_path) as (process, client):
        refused = CliRunner().invoke(command_line(), serve, env=environment)
        assert (refused.exit_code, begun) == (1, [])
        (line,) = refused.stderr.splitlines()
        assert f"already served by process {process.pid} at {str(client.base_url).rstrip('/')}" in line
        assert "--shared" in line
        told = CliRunner().invoke(command_line(), [*serve, "--shared"], env=environment)
        assert (told.exit_code, len(begun)) == (0, 1)
        with serving(settings_in(tmp_path)) as other:
            shape = upload(client, small_file(0), "0.off").json()
            assert other.client.get(f"/shapes/{shape['id']}").status_code == 200
    # The lock ends with its process, and the file alone refuses nothing.
    with ServingLock(path_of(url_in(tmp_path)), "http://127.0.0.1:1"):
        pass
