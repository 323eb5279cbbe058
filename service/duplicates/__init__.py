"""Near-identical stored shapes.

Stored shapes in, kept pairs out; filters in, groups of copies that are turned, scaled, mirrored or remeshed
out; decisions on them kept.
"""

__all__ = ["decision_endpoints", "decision_schemas", "endpoints", "records", "schemas", "service"]
