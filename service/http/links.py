"""Links in the OpenAPI document: what can be done next with the shapes and jobs that an answer names."""

from typing import Any

# The answers that name a shape or a job: the parameter that its id is, and where it stands.
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
# The answers that name a shape that was deleted.
_DELETED = {
    ("delete", "/shapes/{shape_id}", "204"): ("shape_id", "$request.path.shape_id"),
    ("get", "/deleted", "200"): ("shape_id", "$response.body#/shapes/0/id"),
}
# What can be done with such a shape, and with no other.
_FOR_DELETED = {"/shapes/{shape_id}/restore", "/deleted/{shape_id}"}
# The addresses whose body names shapes, and the fields that do.
_BY_BODY = {("post", "/query"): ("shape_id",), ("post", "/compare"): ("first", "second")}


def link(paths: dict[str, Any]) -> None:
    """Write links into a document's operations, by path and method: one to each thing that can be done."""
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
