"""Collections: named sets of shapes, in one of which each call works."""

__all__ = ["endpoints", "repository"]
