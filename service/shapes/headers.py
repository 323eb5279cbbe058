"""Headers of the operations on shapes: parameters of requests, and documentation of those of answers."""

from typing import Annotated, Any

from fastapi import Depends, Header, Request

from service.http.idempotency.keys import HEADER, REPLAYED, read_key

IfMatch = Annotated[
    str | None,
    Header(
        alias="If-Match",
        description="The ETag of the file to replace. If the shape has another file by now, nothing changes.",
    ),
]
NamedKey = Annotated[
    str | None,
    Header(
        alias=HEADER,
        description="A name for the upload, so that a client may send it again: a string in double quotes, "
        "such as a UUID (draft-ietf-httpapi-idempotency-key-header). The same key with the same file and "
        "fields gets the first answer again, for as long as the service keeps that answer; the same key "
        "with another file or other fields is refused. The service keeps no answer of an upload that stored "
        "nothing, and tries such an upload again.",
        json_schema_extra={
            "pattern": r'^"([ !#-\[\]-~]|\\["\\]){1,255}"$',
            "examples": ['"8e03978e-40d5-43e8-bc93-6894a57f9324"'],
        },
    ),
]


async def _idempotency_key(request: Request, _named: NamedKey = None) -> str | None:
    # A header that is repeated is refused, which FastAPI's parameter does not show.
    return read_key(request.headers.getlist(HEADER))


IdempotencyKey = Annotated[str | None, Depends(_idempotency_key)]

REPLAYED_HEADER: dict[str, Any] = {
    REPLAYED: {
        "description": "`true` if this is the answer to an earlier request with the same Idempotency-Key.",
        "schema": {"type": "string", "const": "true"},
    }
}
ETAG_HEADER: dict[str, Any] = {
    "ETag": {"description": "The SHA-256 of the file, in double quotes.", "schema": {"type": "string"}}
}
