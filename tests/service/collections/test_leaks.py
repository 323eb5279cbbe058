"""No address answers with anything of another collection: every one that the document names is tried."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from tempfile import gettempdir, mkdtemp
from typing import Any

import httpx
import pytest

from service.collections.endpoints import HEADER, PARAMETER
from tests.service.engines import on_both
from tests.service.jobs.support import ended, pack
from tests.service.support import (
    Running,
    assert_problem,
    operations,
    serving,
    settings_in,
    small_file,
    upload,
    working_in,
)

pytestmark = on_both

Operation = tuple[str, str]

WITHOUT = {
    ("GET", "/collections"),
    ("PUT", "/collections/{name}"),
    ("DELETE", "/collections/{name}"),
    ("GET", "/healthz"),
    ("GET", "/readyz"),
    ("GET", "/metrics"),
    ("GET", "/version"),
    ("GET", "/session"),
    ("POST", "/session"),
    ("DELETE", "/session"),
    # It shows the file that it is sent.
    ("POST", "/preview"),
}
"""Paths that have to do with no stored shape."""

DOCUMENTED = operations()

FOLDERS = gettempdir()

SECRET = "xyzzy"
"""Part of whatever is written about the shapes of the collection that is kept from the others."""


@dataclass(frozen=True)
class Secrets:
    """The content of the collection `secret`: ids by the request that made them, and hashes of files."""

    kept: str
    twin: str
    deleted: str
    purged: str
    job: str
    source: str
    decision: str
    merge: str
    hashes: tuple[str, ...]

    def ids(self) -> tuple[str, ...]:
        acts = self.job, self.source, self.decision, self.merge
        return self.kept, self.twin, self.deleted, self.purged, *acts


Send = Callable[[httpx.Client, Secrets], httpx.Response]


def to(method: str, path: str, **arguments: Any) -> Send:
    """A request to an address in which ids stand for themselves."""

    def send(client: httpx.Client, own: Secrets) -> httpx.Response:
        shape = {"/shapes/{shape_id}/restore": own.deleted, "/deleted/{shape_id}": own.purged}
        ids = {"job_id": own.job, "source_id": own.source, "decision_id": own.decision}
        ids["merge_id"] = own.merge
        address = path.format(shape_id=shape.get(path, own.kept), **ids)
        return client.request(method, address, **arguments)

    return send


def file(number: int) -> dict[str, Any]:
    return {"files": {"file": ("file.off", small_file(number))}}


def by_id(client: httpx.Client, own: Secrets) -> httpx.Response:
    return client.post("/query", json={"shape_id": own.kept, "top_k": 100})


def both(path: str, **fields: Any) -> Send:
    """A request that names two shapes."""
    return lambda client, own: client.post(path, json={"shapes": [own.kept, own.twin], **fields})


def comparison(client: httpx.Client, own: Secrets) -> httpx.Response:
    return client.post("/compare", json={"first": own.kept, "second": own.kept})


def the_same(client: httpx.Client, own: Secrets) -> httpx.Response:
    """An upload of bytes that lie in the other collection under the same name."""
    return upload(client, small_file(0), f"{SECRET}-kept.off")


def a_merge_undone(client: httpx.Client, own: Secrets) -> httpx.Response:
    answer = both("/duplicates/merge")(client, own)
    if answer.status_code == 200:
        client.post(f"/duplicates/merges/{answer.json()['id']}/undo").raise_for_status()
    return answer


def a_folder(client: httpx.Client, _own: Secrets) -> httpx.Response:
    """A folder that is no source yet, without files."""
    return client.post("/sources", json={"path": mkdtemp(dir=FOLDERS)})


SENT: dict[Operation, list[Send]] = {
    ("GET", "/shapes"): [
        to("GET", "/shapes"),
        to("GET", "/shapes", params={"name": SECRET}),
        to("GET", "/shapes", params={"tag": SECRET}),
        to("GET", "/shapes", params={"metadata": f"secret={SECRET}"}),
    ],
    ("GET", "/facets"): [to("GET", "/facets"), to("GET", "/facets", params={"tag_text": SECRET})],
    ("GET", "/families"): [to("GET", "/families"), to("GET", "/families", params={"name": SECRET})],
    ("GET", "/map"): [to("GET", "/map"), to("GET", "/map", params={"name": SECRET})],
    ("GET", "/map/thumbnails.png"): [to("GET", "/map/thumbnails.png", params={"name": SECRET})],
    ("GET", "/shapes/{shape_id}"): [to("GET", "/shapes/{shape_id}")],
    ("GET", "/shapes/{shape_id}/file"): [
        to("GET", "/shapes/{shape_id}/file"),
        to("GET", "/shapes/{shape_id}/file", params={"format": "stl"}),
    ],
    ("GET", "/shapes/{shape_id}/embedding"): [to("GET", "/shapes/{shape_id}/embedding")],
    ("GET", "/shapes/{shape_id}/thumbnail.png"): [to("GET", "/shapes/{shape_id}/thumbnail.png")],
    ("GET", "/shapes/{shape_id}/preview.glb"): [to("GET", "/shapes/{shape_id}/preview.glb")],
    ("GET", "/shapes/{shape_id}/similar"): [
        to("GET", "/shapes/{shape_id}/similar", params={"top_k": 100, "exclude_self": False}),
        to("GET", "/shapes/{shape_id}/similar", params={"partial": True, "correspondences": True}),
    ],
    ("GET", "/shapes/{shape_id}/suggestions"): [to("GET", "/shapes/{shape_id}/suggestions")],
    ("GET", "/shapes/{shape_id}/view"): [to("GET", "/shapes/{shape_id}/view")],
    ("GET", "/deleted"): [to("GET", "/deleted")],
    ("GET", "/jobs"): [to("GET", "/jobs")],
    ("GET", "/jobs/{job_id}"): [to("GET", "/jobs/{job_id}")],
    ("GET", "/jobs/{job_id}/files"): [to("GET", "/jobs/{job_id}/files")],
    ("GET", "/jobs/{job_id}/events"): [to("GET", "/jobs/{job_id}/events")],
    ("GET", "/duplicates"): [
        to("GET", "/duplicates", params={"variants": True}),
        to("GET", "/duplicates", params={"format": "csv"}),
    ],
    ("GET", "/duplicates/decisions"): [to("GET", "/duplicates/decisions")],
    ("GET", "/duplicates/acts"): [to("GET", "/duplicates/acts")],
    ("GET", "/duplicates/merges"): [to("GET", "/duplicates/merges")],
    ("DELETE", "/duplicates/decisions/{decision_id}"): [to("DELETE", "/duplicates/decisions/{decision_id}")],
    ("POST", "/duplicates/decisions"): [both("/duplicates/decisions", decision="different")],
    ("POST", "/duplicates/rule"): [
        to("POST", "/duplicates/rule", json={"action": "ignore", "likeness": ["same", "variant"]}),
        to("POST", "/duplicates/rule", json={"action": "merge", "dry_run": False}),
    ],
    ("POST", "/query"): [
        to("POST", "/query", **file(0), data={"top_k": 100}),
        to("POST", "/query", **file(0), data={"exhaustive": "true", "tag": SECRET}),
        to("POST", "/query", **file(0), data={"partial": "true", "correspondences": "true"}),
        by_id,
    ],
    ("POST", "/query/batch"): [
        lambda client, own: client.post("/query/batch", json={"shape_ids": [own.kept, own.twin]}),
        to("POST", "/query/batch", **file(0), data={"top_k": 100}),
    ],
    ("PATCH", "/shapes"): [
        to("PATCH", "/shapes", json={"add_tags": ["seen"]}),
        to("PATCH", "/shapes", json={"tag": [SECRET], "set_metadata": {"seen": 1}, "dry_run": False}),
    ],
    ("GET", "/rules"): [to("GET", "/rules")],
    ("PUT", "/rules"): [to("PUT", "/rules", json={"rules": {"secret=*": ["seen"]}})],
    ("POST", "/compare"): [comparison],
    ("POST", "/shapes"): [the_same],
    ("POST", "/jobs"): [
        to("POST", "/jobs", files={"file": ("open.zip", pack({f"{SECRET}-kept.off": small_file(0)}))})
    ],
    ("GET", "/sources"): [to("GET", "/sources")],
    ("POST", "/sources"): [a_folder],
    ("GET", "/equal-files"): [to("GET", "/equal-files")],
    ("GET", "/sources/{source_id}"): [to("GET", "/sources/{source_id}")],
    ("GET", "/sources/{source_id}/files"): [to("GET", "/sources/{source_id}/files")],
    ("PUT", "/sources/{source_id}/rules"): [
        to("PUT", "/sources/{source_id}/rules", json={"rules": {"a/": [SECRET]}})
    ],
    ("POST", "/sources/{source_id}/rescan"): [to("POST", "/sources/{source_id}/rescan")],
    ("POST", "/sources/{source_id}/confirm"): [to("POST", "/sources/{source_id}/confirm")],
    ("DELETE", "/sources/{source_id}"): [to("DELETE", "/sources/{source_id}")],
    ("PATCH", "/shapes/{shape_id}"): [to("PATCH", "/shapes/{shape_id}", json={"tags": ["seen"]})],
    ("POST", "/duplicates/merge"): [a_merge_undone],
    ("POST", "/duplicates/merges/{merge_id}/undo"): [to("POST", "/duplicates/merges/{merge_id}/undo")],
    ("PUT", "/shapes/{shape_id}/file"): [to("PUT", "/shapes/{shape_id}/file", **file(7))],
    ("POST", "/shapes/{shape_id}/restore"): [to("POST", "/shapes/{shape_id}/restore")],
    ("POST", "/jobs/{job_id}/cancel"): [to("POST", "/jobs/{job_id}/cancel")],
    ("DELETE", "/deleted/{shape_id}"): [to("DELETE", "/deleted/{shape_id}")],
    ("DELETE", "/jobs/{job_id}"): [to("DELETE", "/jobs/{job_id}")],
    ("DELETE", "/shapes/{shape_id}"): [to("DELETE", "/shapes/{shape_id}")],
}
"""The request to each address, in an order in which all of it succeeds where the ids belong."""


def in_collections() -> list[Operation]:
    """The operations that name a collection."""
    return [
        operation
        for operation, told in DOCUMENTED.items()
        if {(HEADER, "header"), (PARAMETER, "query")}
        <= {(one["name"], one["in"]) for one in told.get("parameters", [])}
    ]


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory, engine: str) -> Iterator[Running]:
    settings = settings_in(tmp_path_factory.mktemp("leaks"), undo_days=1, source_roots=(FOLDERS,))
    with serving(settings) as running, working_in(running, "open") as other:
        other.store(small_file(5), "open.off")
        yield running


@pytest.fixture(scope="module")
def secrets(running: Running) -> Iterator[Secrets]:
    with working_in(running, "secret") as hidden:
        about = {"tags": SECRET, "metadata": json.dumps({"secret": SECRET})}
        stored = [
            hidden.store(small_file(number), f"{SECRET}-{name}.off", **about)
            for number, name in enumerate(("kept", "twin", "deleted", "purged"))
        ]
        for shape in stored[2:]:
            assert hidden.client.delete(f"/shapes/{shape['id']}").status_code == 204
        archive = pack({f"{SECRET}-of-a-job.off": small_file(4)})
        sent = hidden.client.post("/jobs", files={"file": (f"{SECRET}.zip", archive)}, data=about)
        assert sent.status_code == 202, sent.text
        assert sent.headers["location"] == f"/jobs/{sent.json()['id']}?{PARAMETER}=secret"
        job = ended(hidden.client, sent.json()["id"])
        assert job["counts"]["stored"] == 1
        folder = {"path": mkdtemp(dir=FOLDERS), "name": SECRET}
        source = hidden.client.post("/sources", json=folder)
        assert source.status_code == 201, source.text
        assert source.headers["location"] == f"/sources/{source.json()['id']}?{PARAMETER}=secret"
        ids = [shape["id"] for shape in stored]
        hashes = tuple(shape["sha256"] for shape in stored[1:])
        decided = {"shapes": ids[:2], "decision": "same", "decided_by": SECRET, "reason": SECRET}
        decision = hidden.client.post("/duplicates/decisions", json=decided).json()["id"]
        pair = [
            hidden.store(small_file(number), f"{SECRET}-{name}.off", **about)["id"]
            for number, name in ((8, "merged"), (9, "other"))
        ]
        merge = hidden.client.post("/duplicates/merge", json={"shapes": pair}).json()["id"]
        secrets = (job["id"], source.json()["id"], decision, merge, hashes)
        yield Secrets(*ids[:4], *secrets)


def test_every_address_is_told_which_collection_or_has_to_do_with_none() -> None:
    assert set(in_collections()) == set(DOCUMENTED) - WITHOUT
    assert set(DOCUMENTED) >= WITHOUT
    assert set(SENT) == set(in_collections())


@pytest.mark.parametrize("how", ["header", "parameter"])
@pytest.mark.parametrize("operation", SENT, ids=" ".join)
def test_nothing_of_another_collection_is_answered(
    running: Running, secrets: Secrets, operation: Operation, how: str
) -> None:
    named: dict[str, Any] = (
        {"headers": {HEADER: "open"}} if how == "header" else {"params": {PARAMETER: "open"}}
    )
    with httpx.Client(base_url=running.client.base_url, timeout=120, **named) as client:
        for send in SENT[operation]:
            answer = send(client, secrets)
            told = answer.text + str(answer.headers)
            if answer.status_code >= 400:
                missing = next(
                    (kind for kind in ("job", "source", "decision", "merge") if f"{kind}_id" in operation[1]),
                    "shape",
                )
                assert_problem(answer, 404, f"{missing}-not-found")
                assert SECRET not in told
                continue
            assert "{" not in operation[1]
            # The file comes back under its name, as a shape of the other collection.
            told = told.replace(f"{SECRET}-kept.off", "")
            for secret in (SECRET, *secrets.ids(), *secrets.hashes):
                assert secret not in told


def test_the_collection_is_as_it_was_and_everything_can_be_done_in_it(
    running: Running, secrets: Secrets
) -> None:
    """Also what was refused in the other one, so that it was refused for being there alone."""
    with working_in(running, "secret") as hidden:
        shapes = hidden.client.get("/shapes").json()
        assert shapes["total"] == 4
        assert all(SECRET in shape["name"] and shape["tags"] == [SECRET] for shape in shapes["shapes"])
        for sends in SENT.values():
            for send in sends:
                answer = send(hidden.client, secrets)
                assert answer.status_code < 400, answer.text
                if answer.status_code == 202 and "archive" in answer.json():
                    ended(hidden.client, answer.json()["id"])
        names = {shape["name"] for shape in hidden.client.get("/shapes").json()["shapes"]}
        assert names == {
            f"{SECRET}-{name}.off" for name in ("of-a-job", "deleted", "twin", "merged", "other")
        }
