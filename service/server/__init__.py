"""The service as a process: an application in, a running server with an address out."""

__all__ = ["address", "allocator", "child_process", "http_protocol", "uvicorn_server"]
