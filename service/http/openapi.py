"""The OpenAPI document of the service."""

from collections.abc import Mapping, Sequence
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic.json_schema import models_json_schema

from service.auth.gate import SAFE_METHODS, needed
from service.auth.keys import COOKIE
from service.errors import PROBLEMS
from service.http.problem_document import MEDIA_TYPE, Problem
from service.http.problems import BODY_PROBLEMS, documented

DESCRIPTION = """\
Upload meshes, then search for the stored shapes most similar to another mesh. The service compares distances
along surfaces, so two poses of one body are similar.

* **POST /shapes** stores a mesh file with a name, tags and metadata.
* **POST /query** finds the stored shapes most similar to a file.
* **GET /shapes/{shape_id}/similar** finds the stored shapes most similar to a stored one.
* **POST /compare** compares two shapes point by point, or vertex by vertex.
* **GET /duplicates** finds stored shapes of the same form: rotated, scaled, mirrored or remeshed copies.
* **GET /map** lays the stored shapes out on a plane by similarity.
* **POST /jobs** stores every mesh of an archive.
* **GET /collections** lists the named sets of shapes. Every request works in one collection: the header
  `Isoshape-Collection` or the parameter `collection` names it; without either it is `default`.

A service may require a key, in `Authorization: Bearer` or `X-API-Key`. A full key may do everything; a read
key may read, query and compare. Either kind may be limited to some collections.

Every error is a problem document (`application/problem+json`, RFC 9457), whose `type` never changes. Every
answer has an `X-Request-ID`: the client's own, if the request has one. The service's log has the same id.
"""

TAGS = [
    {"name": "search", "description": "Similar shapes, comparisons, duplicates and maps."},
    {"name": "shapes", "description": "Stored shapes, their files and pictures."},
    {"name": "jobs", "description": "Bulk jobs: archives of many meshes."},
    {"name": "sources", "description": "Folders whose mesh files are shapes and stay where they are."},
    {"name": "collections", "description": "Named sets of shapes."},
    {"name": "session", "description": "Signing in and out, for the page."},
    {"name": "service", "description": "The service itself."},
]

SCHEMES = {
    "bearer": {"type": "http", "scheme": "bearer", "description": "A key, if the service requires one."},
    "header": {
        "type": "apiKey",
        "in": "header",
        "name": "X-API-Key",
        "description": "The same key, in a header of its own.",
    },
    "session": {
        "type": "apiKey",
        "in": "cookie",
        "name": COOKIE,
        "description": "The cookie that POST /session sets in a browser.",
    },
}


def describe(app: FastAPI, refusals: Mapping[str, Sequence[str]]) -> None:
    """Add to the OpenAPI document of an app: problem documents, access and links.

    `refusals` has parameters by name, with the kinds of problem that an operation with the parameter may
    answer.
    """

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            schema = get_openapi(
                title=app.title,
                version=app.version,
                summary=app.summary,
                description=app.description,
                tags=app.openapi_tags,
                routes=app.routes,
            )
            _, problem = models_json_schema(
                [(Problem, "serialization")], ref_template="#/components/schemas/{model}"
            )
            schema["components"]["schemas"].update(problem["$defs"])
            schema["components"]["securitySchemes"] = SCHEMES
            for path, operations in schema["paths"].items():
                for method, operation in operations.items():
                    _say_who_may_ask(method.upper(), path, operation)
                    if "requestBody" in operation:
                        _add_problems(operation, BODY_PROBLEMS)
                    for parameter in operation.get("parameters", []):
                        _add_problems(operation, refusals.get(parameter["name"], ()))
            link(schema["paths"])
            app.openapi_schema = schema
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]


def _say_who_may_ask(method: str, path: str, operation: dict[str, Any]) -> None:
    """Document the keys that an operation accepts, and the problems that refuse a request without one."""
    level = needed(method, path)
    operation["security"] = [] if level is None else [{name: []} for name in SCHEMES]
    kinds = ["misdirected-request"] if method in SAFE_METHODS else ["misdirected-request", "cross-site"]
    if level is not None:
        kinds += ["unauthorized", "rate-limit"]
    if level == "full":
        kinds += ["forbidden"]
    _add_problems(operation, kinds)


def _add_problems(operation: dict[str, Any], kinds: Sequence[str]) -> None:
    """Add kinds of problem to the responses of an operation."""
    responses = operation["responses"]
    documented_kinds = {
        kind
        for status, response in responses.items()
        if int(status) >= 400
        for kind in response["content"][MEDIA_TYPE]["examples"]
    }
    added = {str(PROBLEMS[kind].status) for kind in kinds}
    for status, response in documented(*documented_kinds.union(kinds)).items():
        if str(status) in added:
            responses[str(status)] = response


# Answers that name a shape or a job: the path parameter of its id, and the place of the id in the answer.
_NAMED = {
    ("post", "/shapes", "201"): ("shape_id", "$response.body#/id"),
    ("post", "/shapes", "200"): ("shape_id", "$response.body#/id"),
    ("get", "/shapes", "200"): ("shape_id", "$response.body#/shapes/0/id"),
    ("get", "/shapes/{shape_id}", "200"): ("shape_id", "$response.body#/id"),
    ("patch", "/shapes/{shape_id}", "200"): ("shape_id", "$response.body#/id"),
    ("post", "/query", "200"): ("shape_id", "$response.body#/results/0/shape/id"),
    ("get", "/shapes/{shape_id}/similar", "200"): ("shape_id", "$response.body#/results/0/shape/id"),
    ("post", "/jobs", "202"): ("job_id", "$response.body#/id"),
    ("get", "/jobs", "200"): ("job_id", "$response.body#/jobs/0/id"),
    ("get", "/jobs/{job_id}", "200"): ("job_id", "$response.body#/id"),
}
# Answers that name a deleted shape.
_DELETED = {
    ("delete", "/shapes/{shape_id}", "204"): ("shape_id", "$request.path.shape_id"),
    ("get", "/deleted", "200"): ("shape_id", "$response.body#/shapes/0/id"),
}
# Operations on deleted shapes only.
_FOR_DELETED = {"/shapes/{shape_id}/restore", "/deleted/{shape_id}"}
# Operations whose body names shapes, and the fields that hold the ids.
_BY_BODY = {("post", "/query"): ("shape_id",), ("post", "/compare"): ("first", "second")}


def link(paths: dict[str, Any]) -> None:
    """Add links to the operations of a document, given by path and method."""
    for answers, others, bodies in (
        (_NAMED, set(paths) - _FOR_DELETED, _BY_BODY),
        (_DELETED, _FOR_DELETED, {}),
    ):
        for (method, path, status), (parameter, named) in answers.items():
            paths[path][method]["responses"][status]["links"] = {
                operation["operationId"]: {"operationId": operation["operationId"], **given}
                for operation, given in [
                    *(
                        (operation, {"parameters": {parameter: named}})
                        for other in sorted(others)
                        if f"{{{parameter}}}" in other
                        for operation in paths[other].values()
                    ),
                    *(
                        (paths[other][each], {"requestBody": dict.fromkeys(fields, named)})
                        for (each, other), fields in bodies.items()
                        if parameter == "shape_id"
                    ),
                ]
            }
