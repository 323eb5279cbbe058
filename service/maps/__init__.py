"""Maps of a collection: a filter in, positions of its shapes on a plane by their similarity out."""

__all__ = ["endpoints", "schemas"]
