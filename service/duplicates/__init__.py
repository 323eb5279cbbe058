"""Near-identical stored shapes.

Stored shapes in, kept pairs out; filters in, groups of copies that are turned, scaled, mirrored or remeshed
out.
"""

__all__ = ["endpoints", "schemas", "service"]
