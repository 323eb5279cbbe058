"""Links in the OpenAPI document: from an answer that names a shape or a job to the operations on it."""

from typing import Any

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
