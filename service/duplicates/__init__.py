"""Near-identical stored shapes.

Filters in, groups of copies that are turned, scaled, mirrored or remeshed out.
"""

__all__ = ["endpoints", "schemas"]
