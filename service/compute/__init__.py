"""Heavy work in worker processes: a task in, its result or a named error out."""

__all__ = ["activity_gate", "pool", "processes", "tasks", "work", "worker", "workers"]
