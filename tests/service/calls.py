"""Everything that a service can be asked to do with one shape, for tests in which what it needs fails."""

from collections.abc import Callable

import httpx

from service.storage.checking import check
from service.storage.sqlite import path_of
from tests.service.engines import is_sqlite, url_of
from tests.service.support import Running, small_file, upload, wait_until

Calls = dict[str, Callable[[], httpx.Response]]


def the_kept(running: Running) -> str:
    """The id of the shape with the name "kept"."""
    (shape,) = running.client.get("/shapes", params={"name": "kept"}).json()["shapes"]
    return str(shape["id"])


def changes(running: Running, shape_id: str) -> Calls:
    """Everything that writes. The upload needs no worker: its bytes are stored already."""
    return {
        "upload": lambda: upload(running.client, small_file(0), "again.off", name="again"),
        "change": lambda: running.client.patch(f"/shapes/{shape_id}", json={"tags": ["x"]}),
        "delete": lambda: running.client.delete(f"/shapes/{shape_id}"),
    }


def reads(running: Running, shape_id: str) -> Calls:
    """Everything that only reads. The query finds the shape itself."""
    by_id = {"shape_id": shape_id, "exclude_self": False}
    return {
        "list": lambda: running.client.get("/shapes"),
        "record": lambda: running.client.get(f"/shapes/{shape_id}"),
        "file": lambda: running.client.get(f"/shapes/{shape_id}/file"),
        "embedding": lambda: running.client.get(f"/shapes/{shape_id}/embedding"),
        "query": lambda: running.client.post("/query", json=by_id),
        "compare": lambda: running.client.post("/compare", json={"first": shape_id, "second": shape_id}),
    }


def assert_recovered(running: Running, shape_id: str) -> None:
    """The same process does everything again, and nothing is half done."""
    wait_until(lambda: running.client.get("/readyz").status_code == 200, seconds=60)
    for call in reads(running, shape_id).values():
        assert call().status_code == 200
    stored = upload(running.client, small_file(1), "new.off")
    assert stored.status_code == 201, stored.text
    assert running.client.delete(f"/shapes/{stored.json()['id']}").status_code == 204
    assert [shape["name"] for shape in running.client.get("/shapes").json()["shapes"]] == ["kept"]
    url = url_of(running.container.database)
    if is_sqlite(url):
        assert check(path_of(url), lock_seconds=1).faults == []
