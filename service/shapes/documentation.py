"""The kinds of problem that operations on shapes answer, for the OpenAPI document."""

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
    "cannot-be-embedded",
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

IDEMPOTENCY_PROBLEMS = ("idempotency-key-malformed", "idempotency-key-reused", "idempotency-key-in-flight")
