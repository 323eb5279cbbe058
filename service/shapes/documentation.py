"""What the OpenAPI document says of uploads, which the framework cannot read off the endpoints."""

from typing import Any

from core.io import READABLE
from service.http.idempotency.keys import HEADER, REPLAYED

FILE_PROBLEMS = (
    "bad-request",
    "bad-request-fields",
    "body-too-large",
    "unsupported-media-type",
    "unknown-format",
    "empty-file",
    "malformed-mesh",
    "non-finite-coordinates",
    "no-triangles",
    "degenerate-mesh",
    "mesh-too-complex",
    "external-reference",
    "file-time-limit",
    "busy",
    "shutting-down",
    "worker-lost",
    "cluster-unavailable",
)
EXPORT_PROBLEMS = (
    "mesh-too-complex",
    "non-finite-coordinates",
    "file-time-limit",
    "busy",
    "shutting-down",
    "worker-lost",
    "cluster-unavailable",
)
READ_PROBLEMS = ("bad-request-fields", "storage-unavailable")
WRITE_PROBLEMS = (*READ_PROBLEMS, "storage-full")

FILE_FIELD = {
    "type": "string",
    "contentMediaType": "application/octet-stream",
    "description": f"The mesh. Its name tells the format by the ending: {', '.join(sorted(READABLE))}; step "
    "and stp where the service has the extra for them. 3MF and STEP are read in millimetres.",
}
IDEMPOTENCY_PROBLEMS = ("idempotency-key-malformed", "idempotency-key-reused", "idempotency-key-in-flight")

IDEMPOTENCY_KEY: dict[str, Any] = {
    "name": HEADER,
    "in": "header",
    "required": False,
    "description": "Names the upload, so that it may be sent again: a string in double quotes, as a UUID "
    "(draft-ietf-httpapi-idempotency-key-header). The same key with the same file and fields has the first "
    "answer again, for as long as the service keeps it; with others it is refused. An upload that stored "
    "nothing has no answer to keep, and is tried anew.",
    "schema": {
        "type": "string",
        "pattern": r'^"([ !#-\[\]-~]|\\["\\]){1,255}"$',
        "examples": ['"8e03978e-40d5-43e8-bc93-6894a57f9324"'],
    },
}
REPLAYED_HEADER: dict[str, Any] = {
    REPLAYED: {
        "description": "`true` where this is the answer to an earlier request with the Idempotency-Key.",
        "schema": {"type": "string", "const": "true"},
    }
}
UPLOAD_BODY: dict[str, Any] = {
    "required": True,
    "content": {
        "multipart/form-data": {
            "schema": {
                "type": "object",
                "required": ["file"],
                "additionalProperties": False,
                "properties": {
                    "file": FILE_FIELD,
                    "name": {
                        "type": "string",
                        "description": "What to call it: 1 to 255 characters. Unless given, the file's own "
                        "name, without its folders.",
                    },
                    "tags": {
                        "type": "array",
                        "items": {"type": "string"},
                        "maxItems": 32,
                        "description": "Up to 32 tags: the field repeated, one field with commas, or both.",
                    },
                    "metadata": {
                        "type": "string",
                        "contentMediaType": "application/json",
                        "description": "A JSON object, as text.",
                    },
                },
            }
        }
    },
}
FILE_BODY: dict[str, Any] = {
    "required": True,
    "content": {
        "multipart/form-data": {
            "schema": {
                "type": "object",
                "required": ["file"],
                "additionalProperties": False,
                "properties": {"file": FILE_FIELD},
            }
        }
    },
}
IF_MATCH: dict[str, Any] = {
    "name": "If-Match",
    "in": "header",
    "required": False,
    "description": "The ETag of the file that is to be replaced. If it is another by now, nothing is done.",
    "schema": {"type": "string"},
}
ETAG_HEADER: dict[str, Any] = {
    "ETag": {"description": "Of the file: its SHA-256, in double quotes.", "schema": {"type": "string"}}
}
