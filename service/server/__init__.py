"""The service as a process: an application in, a running server with an address out."""

__all__ = ["process", "uvicorn_server"]
