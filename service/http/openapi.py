"""The OpenAPI document of the service."""

from collections.abc import Mapping, Sequence
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic.json_schema import models_json_schema

from service.auth.rules import SAFE_METHODS, needed
from service.auth.sessions import COOKIE
from service.errors import PROBLEMS
from service.http.links import link
from service.http.problem_document import MEDIA_TYPE, Problem
from service.http.problems import documented

DESCRIPTION = """\
Upload meshes, then ask for the stored ones most like another. Two poses of one body are alike: what is
compared is the shape as one would measure it along its surface.

* **POST /shapes** stores a mesh file with a name, tags and metadata.
* **POST /query** finds the stored shapes most like a file, or like a stored shape.
* **POST /compare** compares two stored shapes point by point.
* **GET /duplicates** finds stored shapes that are one form: turned, scaled, mirrored or meshed anew.
* **POST /jobs** stores every mesh of an archive.
* **GET /collections** lists the named sets of shapes. Every call works in one: that which its header
  `Isoshape-Collection`, or the parameter `collection`, names, or else `default`.

A service may ask for a key, in `Authorization: Bearer` or `X-API-Key`. There are two kinds: one may do
everything, the other may read, query and compare. Either may be limited to some collections.

Every error is a problem document (`application/problem+json`, RFC 9457), whose `type` never changes. Every
answer has an `X-Request-ID`: your own, if you send one, and the one to look for in the logs.
"""

TAGS = [
    {"name": "search", "description": "Which shapes are alike."},
    {"name": "shapes", "description": "What is stored."},
    {"name": "jobs", "description": "Archives of many meshes."},
    {"name": "collections", "description": "Named sets of shapes."},
    {"name": "session", "description": "Signing in, for the page."},
    {"name": "service", "description": "The service itself."},
]

SCHEMES = {
    "bearer": {"type": "http", "scheme": "bearer", "description": "A key, where the service asks for one."},
    "header": {"type": "apiKey", "in": "header", "name": "X-API-Key", "description": "The same."},
    "session": {
        "type": "apiKey",
        "in": "cookie",
        "name": COOKIE,
        "description": "What POST /session sets in a browser.",
    },
}


def describe(app: FastAPI, refusals: Mapping[str, Sequence[str]]) -> None:
    """Have the app's document hold what the framework does not see: the form of problems, and who may ask.

    Parameters
    ----------
    app : FastAPI
    refusals : mapping of str to sequence of str
        For parameters by name: the kinds of problem that an operation with the parameter may answer.
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
                    for parameter in operation.get("parameters", []):
                        _add_problems(operation, refusals.get(parameter["name"], ()))
            link(schema["paths"])
            app.openapi_schema = schema
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]


def _say_who_may_ask(method: str, path: str, operation: dict[str, Any]) -> None:
    """Write into an operation which keys it takes, and how it refuses others."""
    level = needed(method, path)
    operation["security"] = [] if level is None else [{name: []} for name in SCHEMES]
    kinds = [] if method in SAFE_METHODS else ["cross-site"]
    if level is not None:
        kinds += ["unauthorized", "rate-limit"]
    if level == "full":
        kinds += ["forbidden"]
    _add_problems(operation, kinds)


def _add_problems(operation: dict[str, Any], kinds: Sequence[str]) -> None:
    """Have an operation answer these kinds of problem too."""
    responses = operation["responses"]
    there = {
        kind
        for status, response in responses.items()
        if int(status) >= 400
        for kind in response["content"][MEDIA_TYPE]["examples"]
    }
    added = {str(PROBLEMS[kind].status) for kind in kinds}
    for status, response in documented(*there.union(kinds)).items():
        if str(status) in added:
            responses[str(status)] = response
