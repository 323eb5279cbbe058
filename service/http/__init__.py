"""HTTP around the endpoints.

Requests in; limits, problem documents, uploaded files and the OpenAPI document out.
"""

__all__ = [
    "body_limits",
    "idempotency",
    "middleware",
    "openapi",
    "problem_document",
    "problems",
    "request_bodies",
]
