"""Fields, options and filters that cannot be used are refused by their names, in whatever request."""

import base64
import json
import re
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from service.search.schemas import EXCLUDED
from tests.service.support import Running, assert_problem, query, small_file, upload

BIRD = small_file(0)
NO_MESH = {"file": ("bird.off", b"no mesh")}
JSON = {"content-type": "application/json"}

REQUESTS: dict[str, Callable[[httpx.Client, str, Any], httpx.Response]] = {
    "upload": lambda client, _, fields: upload(client, BIRD, "other.off", **fields),
    "list": lambda client, _, params: client.get("/shapes", params=params),
    "change": lambda client, bird, changes: client.patch(f"/shapes/{bird}", json=changes),
    "change as text": lambda client, bird, text: client.patch(f"/shapes/{bird}", content=text, headers=JSON),
    "query": lambda client, _, fields: query(client, BIRD, **fields),
    # Refused before the file is read.
    "query by address": lambda client, _, params: client.post("/query", params=params, files=NO_MESH),
    "similar": lambda client, _, params: client.get("/shapes/none/similar", params=params),
    "query as text": lambda client, _, text: client.post("/query", content=text, headers=JSON),
    "compare as text": lambda client, _, text: client.post("/compare", content=text, headers=JSON),
    "compare": lambda client, bird, params: client.post(
        "/compare", params={"dense": "true", **params}, json={"first": bird, "second": bird}
    ),
}
"""Requests with given fields, by the id of a stored bird."""

SEARCHES = ("query", "query by address", "similar")

WRONG: dict[tuple[str, ...], list[tuple[Any, str]]] = {
    ("upload",): [
        ({"name": "x" * 256}, "name"),
        ({"name": "a\x00b"}, "name"),
        ({"name": ["one", "two"]}, "name"),
        ({"tags": ",".join(f"t{i}" for i in range(33))}, "tags"),
        ({"tags": "x" * 65}, "tags"),
        ({"tags": "a\nb"}, "tags"),
        ({"metadata": "{"}, "metadata"),
        ({"metadata": "[1]"}, "metadata"),
        ({"metadata": '{"a": NaN}'}, "metadata"),
        ({"metadata": '{"a": 1e999}'}, "metadata"),
        ({"metadata": '{"a": "\\ud800"}'}, "metadata"),
        ({"metadata": '{"a": "\\u0000"}'}, "metadata"),
        ({"metadata": json.dumps({"a": "x" * 20_000})}, "metadata"),
        ({"metadata": json.dumps({str(i): i for i in range(65)})}, "metadata"),
        ({"metadata": '{"a":' * 9 + "1" + "}" * 9}, "metadata"),
        ({"metadata": "[" * 30_000}, "metadata"),
        ({"metadata": '{"a": ' + "1" * 5000 + "}"}, "metadata"),
        ({"nmae": "horse"}, "nmae"),
        ({"split": "solids"}, "split"),
    ],
    ("list",): [
        ({"limit": 0}, "limit"),
        ({"limit": 501}, "limit"),
        ({"limit": "many"}, "limit"),
        ({"metadata": "year"}, "metadata"),
        ({"metadata": "=2024"}, "metadata"),
        ({"metadata": ["a=b"] * 33}, "metadata"),
        ({"metadata": [f"k{i}=v" for i in range(1100)]}, "metadata"),
        ({"tag": [f"t{i}" for i in range(33)]}, "tag"),
        ({"tag": ",".join(f"t{i}" for i in range(1100))}, "tag"),
        ({"tags": "animal"}, "tags"),
        *(
            ({"cursor": cursor}, "cursor")
            for cursor in ("x", "!!!", "e30", "eyJhZnRlciI6IC0xfQ", "eyJhZnRlciI6ICJhIn0", "WzFd")
        ),
        # A boolean, half of a surrogate pair, a zero, and lists in lists.
        *(
            ({"cursor": base64.urlsafe_b64encode(content.encode()).decode(), "sort": "name"}, "cursor")
            for content in (
                '{"after": true, "name": "a"}',
                '{"after": 1, "name": "\\ud800"}',
                '{"after": 1, "name": "\\u0000"}',
                "[" * 3000,
            )
        ),
        ({"metadata": "year=\0"}, "metadata"),
    ],
    ("change",): [
        ({"name": ""}, "name"),
        ({"name": "x" * 256}, "name"),
        ({"name": 3}, "name"),
        ({"tags": "a,b"}, "tags"),
        ({"tags": ["a,b"]}, "tags"),
        ({"tags": [""]}, "tags"),
        ({"tags": [str(i) for i in range(33)]}, "tags"),
        ({"metadata": [1]}, "metadata"),
        ({"metadata": {"": 1}}, "metadata"),
        ({"id": "x"}, "id"),
    ],
    ("change as text", "query as text", "compare as text"): [("{", "body"), ("[]", "body"), ("", "body")],
    ("query as text", "compare as text"): [("[" * 5000, "body")],
    ("change as text",): [
        ('{"metadata": {"a": 1e999}}', "metadata"),
        ('{"metadata": {"a": NaN}}', "metadata"),
        ('{"name": "\\ud800"}', "name"),
    ],
    ("query as text",): [
        ("{}", "shape_id"),
        ('{"shape_id": 3}', "shape_id"),
        ('{"shape_id": "a", "top_k": 1e999}', "top_k"),
        ('{"shape_id": "\\ud800"}', "shape_id"),
    ],
    SEARCHES: [
        ({"top_k": 0}, "top_k"),
        ({"top_k": 101}, "top_k"),
        ({"top_k": "three"}, "top_k"),
        ({"top_k": "NaN"}, "top_k"),
        ({"top_k": ["1", "2"]}, "top_k"),
        ({"rank_by": "beauty"}, "rank_by"),
        ({"exhaustive": "perhaps"}, "exhaustive"),
        ({"partial": "perhaps"}, "partial"),
        ({"topk": 3}, "topk"),
        ({"shape_id": "x"}, "shape_id"),
        ({"tag": "x" * 65}, "tag"),
        ({"name": "x" * 256}, "name"),
        ({"metadata": "year"}, "metadata"),
        ({"metadata": "=2024"}, "metadata"),
        ({"min_cc": 1.5}, "min_cc"),
        ({"min_cc": "nan"}, "min_cc"),
        ({"scale": "double"}, "scale"),
        ({"exclude": ["x" * 65]}, "exclude.0"),
        ({"exclude": ",".join("x" * (EXCLUDED + 1))}, "exclude"),
        *(
            ({"scale": "respect", "size_tolerance": wrong}, "size_tolerance")
            for wrong in ("0", "10.5", "nan")
        ),
    ],
    ("compare",): [
        ({"format": "npz", "dense": "false"}, "format"),
        ({"format": "png", "dense": "false"}, "format"),
        ({"format": "glb", "dense": "false", "paint": "difference"}, "paint"),
        ({"format": "html"}, "format"),
        ({"paint": "rainbow"}, "paint"),
        ({"dense": "perhaps"}, "dense"),
    ],
}
"""By the requests that refuse it: what is sent, and the field that it is refused by."""

CASES = [(kind, sent, field) for kinds, cases in WRONG.items() for kind in kinds for sent, field in cases]


@pytest.fixture(scope="module")
def bird(shared: Running) -> dict[str, Any]:
    shared.clear()
    return shared.store(BIRD, "bird.off")


@pytest.mark.parametrize(("kind", "sent", "field"), CASES, ids=lambda value: str(value)[:30])
def test_a_wrong_field_is_refused_by_its_name(
    shared: Running, bird: dict[str, Any], kind: str, sent: Any, field: str
) -> None:
    answer = REQUESTS[kind](shared.client, bird["id"], sent)
    problem = assert_problem(answer, 422, "bad-request-fields")
    assert all(f"{error['field']}.".startswith(f"{field}.") for error in problem["errors"])
    assert field in problem["detail"]
    # The words of the service, not those of a library.
    assert not re.search("Input|Extra|Field required|should", problem["detail"])
    assert shared.client.get("/shapes").json()["shapes"] == [bird]
