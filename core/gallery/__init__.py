"""Synthetic articulated shapes, for the demo and the tests: a class, a pose and a seed in, a mesh out."""

from core.gallery.collection import CLASSES, GalleryShape, make_gallery, make_shape

__all__ = [
    "CLASSES",
    "GalleryShape",
    "bodies",
    "individuals",
    "make_gallery",
    "make_shape",
    "poses_of_one_person",
]
