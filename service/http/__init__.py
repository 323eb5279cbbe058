"""HTTP around the endpoints.

Requests in; limits, problem documents, uploaded files and the OpenAPI document out.
"""

__all__ = [
    "access_control",
    "body_limits",
    "disconnects",
    "duplicate_parameters",
    "middleware",
    "openapi",
    "problem_document",
    "problems",
    "request_bodies",
]
