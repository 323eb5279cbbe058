"""What the service tells its operator: events in, log lines, metrics and timings out."""

__all__ = ["logging", "metrics", "timings"]
