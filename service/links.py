"""Links in the OpenAPI document: what can be done next with the shapes that an answer names."""

from typing import Any

# The answers that name a shape, and where in their body its id stands.
_NAMED = {
    ("post", "/shapes", "201"): "/id",
    ("post", "/shapes", "200"): "/id",
    ("get", "/shapes", "200"): "/shapes/0/id",
    ("get", "/shapes/{shape_id}", "200"): "/id",
    ("patch", "/shapes/{shape_id}", "200"): "/id",
    ("post", "/query", "200"): "/results/0/shape/id",
}
# The addresses whose body names shapes, and the fields that do.
_BY_BODY = {("post", "/query"): ("shape_id",), ("post", "/compare"): ("first", "second")}


def link(paths: dict[str, Any]) -> None:
    """Write links into a document's operations, by path and method: one to each thing done with a shape."""
    for (method, path, status), pointer in _NAMED.items():
        named = f"$response.body#{pointer}"
        paths[path][method]["responses"][status]["links"] = {
            **{
                operation["operationId"]: {
                    "operationId": operation["operationId"],
                    "parameters": {"shape_id": named},
                }
                for operation in _by_address(paths)
            },
            **{
                paths[other][each]["operationId"]: {
                    "operationId": paths[other][each]["operationId"],
                    "requestBody": dict.fromkeys(fields, named),
                }
                for (each, other), fields in _BY_BODY.items()
            },
        }


def _by_address(paths: dict[str, Any]) -> list[dict[str, Any]]:
    """The operations at addresses that hold the id of a shape."""
    return [operation for path, each in paths.items() if "{shape_id}" in path for operation in each.values()]
