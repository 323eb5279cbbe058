"""Heavy work in worker processes: a task in, its result or a named error out."""

__all__ = ["compilation", "pool", "request_queue", "sandbox", "tasks", "worker_loop"]
