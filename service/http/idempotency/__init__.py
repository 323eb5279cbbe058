"""The header Idempotency-Key: a repeated request in, the first request's answer out."""

__all__ = ["keys", "repository"]
