"""Authentication: the headers of a request in, the grant of its key or session out."""

__all__ = ["gate", "keys"]
