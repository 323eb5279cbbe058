"""Synthetic articulated shapes, for the demo and the tests: a class, a pose and a seed in, a mesh out."""

from core.gallery.collection import CLASSES, GalleryShape, make_gallery, make_shape

__all__ = [
    "CLASSES",
    "GalleryShape",
    "bodies",
    "make_gallery",
    "make_shape",
]
