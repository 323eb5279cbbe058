"""The problem document (RFC 9457) as the service writes it and a client reads it."""

from collections.abc import Sequence
from typing import Any, Self

from pydantic import BaseModel, Field

from service.errors import PROBLEMS, FieldFault, fault_text

MEDIA_TYPE = "application/problem+json"
TYPE_PREFIX = "urn:isoshape:problem:"
INSTANCE_PREFIX = "urn:isoshape:request:"
# The most faults of an answer.
FAULTS = 100


class Cause(BaseModel):
    """The problem (RFC 9457) of a file or a job, outside the answer to a request."""

    type: str = Field(
        description="The kind of problem. It never changes, so a program may branch on it.",
        json_schema_extra={"enum": [TYPE_PREFIX + kind for kind in PROBLEMS]},
    )
    title: str = Field(description="The kind of problem in words.")
    status: int = Field(
        description="The HTTP status; of a file of a job or a batch, that of the single file."
    )
    detail: str = Field(description="What happened, for people.")

    @classmethod
    def of(cls, kind: str, detail: str, **fields: Any) -> Self:  # noqa: ANN401
        """Return the problem of a kind."""
        row = PROBLEMS[kind]
        return cls(type=TYPE_PREFIX + kind, title=row.title, status=row.status, detail=detail, **fields)

    @property
    def text(self) -> str:
        """Return the title and, unless it says the same, the detail."""
        said = self.detail.casefold() == self.title.casefold()
        return self.title if said else f"{self.title}: {self.detail}"


class Problem(Cause):
    """The answer to every request that fails (RFC 9457)."""

    instance: str = Field(description="The occurrence: a URN with the id of the request.")
    request_id: str = Field(
        description="The id of the request, as in the X-Request-ID header and in the logs."
    )
    errors: list[FieldFault] | None = Field(
        default=None, description="The fields at fault, each with a message."
    )

    @classmethod
    def answering(cls, request_id: str, kind: str, detail: str, faults: Sequence[FieldFault] = ()) -> Self:
        """Return the answer to a request."""
        instance, errors = INSTANCE_PREFIX + request_id, list(faults) or None
        return cls.of(kind, detail, instance=instance, request_id=request_id, errors=errors)


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
        faults.append(FieldFault(".".join(location) or "body", fault_text(error)))
    return faults
