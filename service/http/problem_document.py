"""The problem document (RFC 9457) as the service writes it and a client reads it."""

from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel, Field

from service.errors import PROBLEMS, FieldFault

MEDIA_TYPE = "application/problem+json"
TYPE_PREFIX = "urn:isoshape:problem:"
INSTANCE_PREFIX = "urn:isoshape:request:"
# The most faults of an answer.
FAULTS = 100


class Fault(BaseModel):
    """A fault of one field of a request."""

    field: str = Field(examples=["metadata"])
    message: str = Field(examples=["not JSON: Expecting value at character 0"])


class Problem(BaseModel):
    """The answer to every request that fails (RFC 9457)."""

    type: str = Field(
        description="The kind of problem. It never changes, so a program may branch on it.",
        json_schema_extra={"enum": [TYPE_PREFIX + kind for kind in PROBLEMS]},
    )
    title: str = Field(description="The kind of problem in words.")
    status: int = Field(description="The HTTP status.")
    detail: str = Field(description="What happened in this request, for people.")
    instance: str = Field(description="The occurrence: a URN with the id of the request.")
    request_id: str = Field(
        description="The id of the request, as in the X-Request-ID header and in the logs."
    )
    errors: list[Fault] | None = Field(default=None, description="The fields at fault, each with a message.")


def faults_of(errors: Sequence[Any]) -> list[FieldFault]:
    """Return the first `FAULTS` of pydantic's errors, each with the client's name of the field."""
    faults = []
    for error in errors[:FAULTS]:
        location = [str(part) for part in error["loc"]]
        if (
            location
            and location[0] in {"body", "query", "path", "header"}
            and error["type"] != "json_invalid"
        ):
            location = location[1:]
        message = error["msg"].removeprefix("Value error, ")
        faults.append(FieldFault(".".join(location) or "body", message))
    return faults
