"""The service itself over HTTP: health, readiness, version, metrics and signing in."""

__all__ = ["endpoints", "schemas"]
