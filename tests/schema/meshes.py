"""Meshes for the tests that are generated from the OpenAPI document."""

from functools import cache
from typing import Any

import requests
import schemathesis
from hypothesis import strategies as st

from core.reading import FORMATS
from tests.service.support import small_file

FORMAT = "mesh"


@cache
def meshes() -> dict[bytes, str]:
    """Sound files, each with its format."""
    return {small_file(number, format): format for number in range(3) for format in FORMATS}


def register() -> None:
    """Have files of meshes generated where a schema says that a text is of the format "mesh"."""
    schemathesis.openapi.format(FORMAT, st.sampled_from(sorted(meshes())))


def mark_files(document: dict[str, Any]) -> None:
    """Say of every upload in the document that it is of that format."""
    for path in document["paths"].values():
        for operation in path.values():
            content = operation.get("requestBody", {}).get("content", {})
            form = content.get("multipart/form-data", {}).get("schema", {})
            if "file" in form.get("properties", {}):
                form["properties"] = {
                    **form["properties"],
                    "file": {**form["properties"]["file"], "format": FORMAT},
                }


def forget_repetitions(document: dict[str, Any]) -> None:
    """Leave out where the answer to a repeated upload leads: another request may have deleted that shape."""
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
