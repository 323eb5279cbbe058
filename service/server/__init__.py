"""The service as a process: an application in, a running server and its address out."""

__all__ = ["address", "child_process", "uvicorn_server"]
