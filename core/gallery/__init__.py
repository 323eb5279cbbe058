"""Synthetic articulated shapes, for the demo and the tests: a class, a pose and a seed in, a mesh out."""

from core.gallery.collection import CLASSES, make_shape

__all__ = ["CLASSES", "bodies", "make_shape"]
