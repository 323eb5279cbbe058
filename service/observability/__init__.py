"""Observability: events in; log lines, metrics and timings out."""

__all__ = ["logging", "metrics"]
