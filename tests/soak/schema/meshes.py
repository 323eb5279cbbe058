"""Files and cursors for the tests that are generated from the OpenAPI document."""

from functools import cache
from typing import Any

import requests
import schemathesis
from hypothesis import strategies as st

from service.collection import DEFAULT_COLLECTION
from service.collections.endpoints import HEADER, PARAMETER
from service.shapes.schemas import write_cursor
from tests.core.io.files import PLAIN
from tests.service.jobs.support import pack
from tests.service.support import small_file

MESH, ARCHIVE, CURSOR = "mesh", "archive", "cursor"


@cache
def meshes() -> dict[bytes, str]:
    """Sound files, each with its format."""
    return {small_file(number, format): format for number in range(3) for format in PLAIN}


@cache
def archives() -> tuple[bytes, ...]:
    """Archives of meshes that are no others, and of what is none; the times in them are always the same."""
    contents = ({"3.off": small_file(3), "4.stl": small_file(4, "stl")}, {"a/none.obj": b"v 0 0 0\n"})
    return tuple(pack(files) for files in contents)


def register() -> None:
    """Have files and cursors generated where a schema says that a text is of their format."""
    schemathesis.openapi.format(MESH, st.sampled_from(sorted(meshes())))
    schemathesis.openapi.format(ARCHIVE, st.sampled_from(sorted(archives())))
    schemathesis.openapi.format(CURSOR, st.integers(0, 5).map(write_cursor))


def narrow(document: dict[str, Any]) -> None:
    """Say which texts are meshes, archives and cursors, and have requests name the collection that is there.

    Other names of collections are 404, and two that differ refused. No link leads from a repeated upload:
    another request may have deleted that shape.
    """
    for path, operations in document["paths"].items():
        for operation in operations.values():
            content = operation.get("requestBody", {}).get("content", {})
            properties = content.get("multipart/form-data", {}).get("schema", {}).get("properties", {})
            if "file" in properties:
                file = properties["file"]
                if "items" in file:
                    # A few meshes are a batch.
                    file["maxItems"], file = 3, file["items"]
                file["format"] = ARCHIVE if path == "/jobs" else MESH
            for parameter in operation.get("parameters", []):
                if parameter["name"] == "cursor":
                    parameter["schema"] = {"type": "string", "format": CURSOR}
                elif parameter["name"] in {HEADER, PARAMETER}:
                    parameter["schema"] = {"type": "string", "enum": [DEFAULT_COLLECTION.name]}
    del document["paths"]["/shapes"]["post"]["responses"]["200"]["links"]


class NamingSession(requests.Session):
    """Sends each mesh under a name with the ending of its format; what is no mesh is called an OFF."""

    def prepare_request(self, request: requests.Request) -> requests.PreparedRequest:
        """The request with other filenames."""
        if isinstance(request.files, list):
            request.files = [self._named(*part) for part in request.files]
        return super().prepare_request(request)

    @staticmethod
    def _named(field: str, part: tuple[Any, ...]) -> tuple[str, tuple[Any, ...]]:
        filename, content, *rest = part
        if filename is not None:
            data = getattr(content, "data", content)
            filename = f"mesh.{meshes().get(data, 'off') if isinstance(data, bytes) else 'off'}"
        return field, (filename, content, *rest)
