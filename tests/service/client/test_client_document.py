"""The requests of both clients, and how they read the answers, against the OpenAPI document."""

import json
import re
from collections.abc import Callable, Iterable
from email import message_from_bytes
from typing import Any

import httpx
import jsonschema_rs
import pytest
from pydantic import BaseModel

from service.client import Client, Upload
from service.duplicates.decision_schemas import Rule
from service.shapes.bulk_schemas import BulkChange
from tests.service.cli.awaited import Awaited
from tests.service.support import document

DOCUMENT = document()
FILE = ("bird.off", b"OFF")
SIZES = {"area": "1..2", "volume": "..3", "length": "4..", "file_format": "off"}
FILTERS = {"q": "w", "tag": ["a", "b"], "name": "x", "metadata": ["k=1", "l=2"], **SIZES}
LISTED = {**FILTERS, "sort": "name"}
SEARCH = {
    "top_k": 2,
    "rank_by": "sim",
    "partial": True,
    "exhaustive": True,
    **FILTERS,
    "exclude": ["id"],
    "min_cc": 0.5,
    "scale": "respect",
    "size_tolerance": 0.2,
    "exclude_self": False,
    "correspondences": True,
    "embedding": True,
}
STORED = {"name": "x", "tags": ["a", "b"], "metadata": {"k": 1}}
RULE = Rule(action="merge", decided_by="a", q="w", name="x", **SIZES)
BULK = BulkChange(add_tags=["a"], collection="b", q="w", name="x", **SIZES)
# Every method with all that it takes, and what it calls.
CALLS: list[tuple[str, tuple[object, ...], dict[str, Any], str]] = [
    ("upload", (FILE,), {**STORED, "split": "parts"}, "POST /shapes"),
    ("page", (), {**LISTED, "limit": 7, "cursor": "c", "sha256": "0" * 64}, "GET /shapes"),
    ("shapes", (), {**LISTED, "sha256": "0" * 64}, "GET /shapes"),
    ("facets", (), {**FILTERS, "tag_text": "a", "limit": 7}, "GET /facets"),
    ("shape", ("id",), {}, "GET /shapes/{shape_id}"),
    ("file", ("id",), {"format": "stl"}, "GET /shapes/{shape_id}/file"),
    ("embedding", ("id",), {}, "GET /shapes/{shape_id}/embedding"),
    ("thumbnail", ("id",), {"size": 128}, "GET /shapes/{shape_id}/thumbnail.png"),
    ("preview", ("id",), {}, "GET /shapes/{shape_id}/preview.glb"),
    ("preview_file", (FILE,), {}, "POST /preview"),
    ("replace_file", ("id", FILE), {"if_sha256": "0" * 64}, "PUT /shapes/{shape_id}/file"),
    ("update", ("id",), {**STORED, "collection": "b"}, "PATCH /shapes/{shape_id}"),
    ("update_all", (BULK,), {}, "PATCH /shapes"),
    ("delete", ("id",), {"permanent": True}, "DELETE /shapes/{shape_id}"),
    ("deleted", (), {}, "GET /deleted"),
    ("restore", ("id",), {}, "POST /shapes/{shape_id}/restore"),
    ("purge", ("id",), {}, "DELETE /deleted/{shape_id}"),
    ("send_archive", (FILE,), {"tags": ["a"], "metadata": {"k": 1}}, "POST /jobs"),
    ("job", ("id",), {}, "GET /jobs/{job_id}"),
    ("follow_job", ("id",), {"seconds": 0.0}, "GET /jobs/{job_id}"),
    ("jobs", (), {}, "GET /jobs"),
    ("job_files", ("id",), {"outcome": "refused"}, "GET /jobs/{job_id}/files"),
    ("cancel_job", ("id",), {}, "POST /jobs/{job_id}/cancel"),
    ("delete_job", ("id",), {}, "DELETE /jobs/{job_id}"),
    ("sources", (), {}, "GET /sources"),
    (
        "add_source",
        ("/m",),
        {"name": "x", "tags": ["a"], "rules": {"p/": ["b"]}, "copies": True},
        "POST /sources",
    ),
    ("source", ("id",), {}, "GET /sources/{source_id}"),
    ("follow_source", ("id",), {"seconds": 0.0}, "GET /sources/{source_id}"),
    ("source_files", ("id",), {"state": "missing", "shape_id": "id"}, "GET /sources/{source_id}/files"),
    ("equal_files", (), {"merged": True}, "GET /equal-files"),
    ("set_source_rules", ("id", {"p/": ["b"]}), {}, "PUT /sources/{source_id}/rules"),
    ("rules", (), {}, "GET /rules"),
    ("set_rules", ({"k=v*": ["b"]},), {}, "PUT /rules"),
    ("rescan_source", ("id",), {}, "POST /sources/{source_id}/rescan"),
    ("confirm_source", ("id",), {}, "POST /sources/{source_id}/confirm"),
    ("remove_source", ("id",), {}, "DELETE /sources/{source_id}"),
    ("query_file", (FILE,), SEARCH, "POST /query"),
    ("query_shape", ("id",), SEARCH, "POST /query"),
    ("query_batch", (["id", "other"],), SEARCH, "POST /query/batch"),
    ("query_batch", ([FILE],), SEARCH, "POST /query/batch"),
    ("similar", ("id",), SEARCH, "GET /shapes/{shape_id}/similar"),
    (
        "compare",
        ("id", "other"),
        {
            "dense": True,
            "landmarks": [((0, 0, 0), (1, 1, 1))],
            "points": [(0, 0, 1)],
            "curves": [[(0, 0, 0), (0, 1, 1)]],
            "values": [0.5],
        },
        "POST /compare",
    ),
    (
        "duplicates",
        (),
        {
            "max_residual": 0.002,
            "scaled": True,
            "mirrored": False,
            "variants": True,
            "decided": True,
            "judging_seconds": 0.5,
            "limit": 5,
            **FILTERS,
        },
        "GET /duplicates",
    ),
    ("decide", (["id", "other"], "same"), {"decided_by": "a", "reason": "b"}, "POST /duplicates/decisions"),
    ("decisions", (), {}, "GET /duplicates/decisions"),
    ("delete_decision", ("id",), {}, "DELETE /duplicates/decisions/{decision_id}"),
    ("merge", (["id", "other"],), {"keep": "newest"}, "POST /duplicates/merge"),
    ("merges", (), {}, "GET /duplicates/merges"),
    ("acts", (), {"limit": 5}, "GET /duplicates/acts"),
    ("undo_merge", ("id",), {}, "POST /duplicates/merges/{merge_id}/undo"),
    ("apply_rule", (RULE,), {}, "POST /duplicates/rule"),
    ("suggestions", ("id",), {"least_share": 0.8}, "GET /shapes/{shape_id}/suggestions"),
    ("families", (), {"least_probability": 0.8, **FILTERS}, "GET /families"),
    ("similarity_map", (), FILTERS, "GET /map"),
    ("collections", (), {}, "GET /collections"),
    ("create_collection", ("a",), {}, "PUT /collections/{name}"),
    ("delete_collection", ("a",), {}, "DELETE /collections/{name}"),
    ("version", (), {}, "GET /version"),
    ("ready", (), {}, "GET /readyz"),
]
SERIES = {
    "shapes",
    "deleted",
    "decisions",
    "merges",
    "jobs",
    "job_files",
    "follow_job",
    "follow_source",
    "source_files",
    "equal_files",
}
# Paths that browsers and probes ask for, and the one that `follow_job` does by asking again.
NOT_CALLED = {
    "GET /healthz",
    "GET /metrics",
    "GET /session",
    "POST /session",
    "DELETE /session",
    "GET /shapes/{shape_id}/view",
    "GET /map/thumbnails.png",
    "GET /jobs/{job_id}/events",
}
# Forms that are not models, and an answer that is kept for who sends again without knowing what became of it.
NOT_SENT = {
    "GET /duplicates": {"format"},
    "POST /compare": {"format", "paint", "dense"},
    "GET /shapes/{shape_id}/embedding": {"format"},
    "POST /shapes": {"Idempotency-Key"},
}
CASES = [pytest.param(*case, id=case[0]) for case in CALLS]


def operation(request: httpx.Request) -> str:
    """The one operation of the document that a request is for."""
    fitting = [
        f"{method.upper()} {path}"
        for path, methods in DOCUMENT["paths"].items()
        for method in methods
        if method.upper() == request.method
        and re.fullmatch(re.sub(r"\{\w+\}", "[^/]+", path), request.url.path)
    ]
    assert len(fitting) == 1, (request.method, request.url, fitting)
    return fitting[0]


def describe(name: str) -> dict[str, Any]:
    method, path = name.split()
    return DOCUMENT["paths"][path][method.lower()]


def resolved(schema: dict[str, Any]) -> dict[str, Any]:
    return (
        DOCUMENT["components"]["schemas"][schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema
    )


def fits(value: object, schema: dict[str, Any]) -> bool:
    whole = {**schema, "components": DOCUMENT["components"]}
    return jsonschema_rs.validator_for(whole).is_valid(value)


def text_fits(values: list[str], schema: dict[str, Any]) -> bool:
    """Whether a parameter of an address or a form is what the schema says: text, or written as in JSON."""
    if schema.get("type") == "array":
        return all(text_fits([value], schema["items"]) for value in values)
    (value,) = values
    try:
        return fits(value, schema) or fits(json.loads(value), schema)
    except ValueError:
        return False


def check_given(given: dict[str, list[str]], known: dict[str, Any], left_out: Iterable[str]) -> None:
    """All that the document knows is sent, but what is left out, and as it says."""
    assert set(given) == set(known) - set(left_out)
    for name, values in given.items():
        assert text_fits(values, known[name]), (name, values)


def check_address(request: httpx.Request, name: str, paged: bool) -> None:
    parameters = describe(name).get("parameters", [])
    known = {each["name"]: each["schema"] for each in parameters if each["in"] == "query"}
    given = {key: request.url.params.get_list(key) for key in request.url.params}
    # The collection is named by the header.
    left_out = NOT_SENT.get(name, set()) | ({"cursor"} if paged else set()) | {"collection"}
    # Options of a query are in its body.
    check_given(given, {} if name == "POST /query" else known, left_out)
    for each in parameters:
        if each["in"] == "header" and each["name"] not in left_out:
            assert fits(request.headers[each["name"]], each["schema"])


def check_body(request: httpx.Request, name: str) -> None:
    body = describe(name).get("requestBody", {"content": {}})["content"]
    kind = request.headers.get("content-type", "").partition(";")[0]
    if not body:
        assert (kind, request.content) == ("", b"")
        return
    schema = resolved(body[kind]["schema"])
    if kind == "application/json":
        sent = json.loads(request.content)
        assert fits(sent, schema)
        assert set(sent) == set(schema["properties"])
        return
    head = f"Content-Type: {request.headers['content-type']}\r\n\r\n".encode()
    fields: dict[str, list[str]] = {}
    for part in message_from_bytes(head + request.content).get_payload():
        key = str(part.get_param("name", header="content-disposition"))
        fields.setdefault(key, []).append(part.get_payload(decode=True).decode())
    assert fields["file"] == ["OFF"]
    check_given(fields, schema["properties"], ())


def example(schema: dict[str, Any]) -> Any:
    """A value that a schema describes, with everything in it that may be; null where that may be."""
    schema = resolved(schema)
    choices = schema.get("anyOf", [])
    if {"type": "null"} in choices:
        return None
    if choices:
        return example(choices[0])
    kind = schema.get("type")
    if "const" in schema or "enum" in schema:
        return schema.get("const", schema.get("enum", [None])[-1])
    if kind == "object":
        return {name: example(inner) for name, inner in schema.get("properties", {}).items()}
    if kind == "array":
        return [example(schema["items"])] * schema.get("minItems", 1)
    if kind == "string":
        return "2026-01-31T12:00:00Z" if schema.get("format") == "date-time" else "x"
    return {"integer": 3, "number": 0.5, "boolean": True, None: 1}[kind]


def fullest(schema: dict[str, Any]) -> dict[str, Any]:
    """The schema of the answer to a request with every option: the last of several."""
    return schema.get("anyOf", [schema])[-1]


def answer(name: str) -> httpx.Response:
    """The answer in the document."""
    responses = describe(name)["responses"]
    status = max(int(each) for each in responses if int(each) < 300)
    content = responses[str(status)].get("content", {})
    if not content:
        return httpx.Response(status)
    kind = next(iter(content))
    if kind == "application/json":
        made = example(fullest(content[kind]["schema"]))
        assert fits(made, content[kind]["schema"])
        return httpx.Response(status, json=made)
    return httpx.Response(status, content=b"bytes", headers={"content-type": kind})


def check_read(read: Any, name: str) -> None:
    """The result of a method is the model that the document names, with the values of its example."""
    sent = answer(name)
    if not sent.content:
        assert read is None
    elif sent.headers["content-type"] != "application/json":
        assert read == b"bytes"
    else:
        schema = next(
            each["content"]["application/json"]["schema"]
            for status, each in describe(name)["responses"].items()
            if int(status) == sent.status_code
        )
        model = read.shape if isinstance(read, Upload) else read
        assert isinstance(model, BaseModel)
        assert fullest(schema) == {"$ref": f"#/components/schemas/{type(model).__name__}"}
        assert model.model_dump(mode="json") == sent.json()


@pytest.mark.parametrize("make", [Client, Awaited], ids=["waiting", "awaited"])
@pytest.mark.parametrize(("method", "given", "options", "called"), CASES)
def test_a_call_is_as_the_document_says(
    make: Callable[..., Client], method: str, given: tuple[object, ...], options: dict[str, Any], called: str
) -> None:
    requests: list[httpx.Request] = []

    def respond(request: httpx.Request) -> httpx.Response:
        requests.append(request)
        return answer(operation(request))

    with make("http://elsewhere", collection="a-1", transport=httpx.MockTransport(respond)) as client:
        read = getattr(client, method)(*given, **options)
        if method in SERIES:
            read = list(read)
    (request,) = requests
    assert operation(request) == called
    check_address(request, called, paged=method in SERIES)
    check_body(request, called)
    if method == "ready":
        assert read is True
    elif method not in SERIES:
        check_read(read, called)
    else:
        (only,) = read
        page = answer(called).json()
        (items,) = (
            [each for each in page.values() if isinstance(each, list)] if "id" not in page else [[page]]
        )
        assert [only.model_dump(mode="json")] == items


def test_every_method_is_checked() -> None:
    public = {name for name in dir(Client) if not name.startswith("_")}
    assert public - {"close", "send", "send_all"} == {method for method, *_ in CALLS}


def test_every_operation_is_called_or_is_not_for_programs() -> None:
    operations = {
        f"{method.upper()} {path}" for path, methods in DOCUMENT["paths"].items() for method in methods
    }
    assert operations - {called for *_, called in CALLS} == NOT_CALLED
