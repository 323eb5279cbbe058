"""Heavy work in worker processes: a task in, its result or a named error out."""

__all__ = ["compilation", "executor", "pool", "reader_answers", "request_queue", "tasks", "worker_loop"]
