"""The page at / and the documentation at /docs: a request in, package files with their headers out."""

__all__ = ["endpoints"]
