"""Heavy work in worker processes: a task in, its result or a named error out."""

__all__ = [
    "activity_gate",
    "compilation",
    "part_bytes",
    "pool",
    "request_queue",
    "start_processes",
    "tasks",
    "worker_loop",
    "workers_interface",
]
