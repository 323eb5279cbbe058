"""Articulated shapes made from code: the demo's and the tests' own collection."""

from core.gallery.collection import CLASSES, GalleryShape, make_gallery, make_shape

__all__ = ["CLASSES", "GalleryShape", "bodies", "make_gallery", "make_shape", "one_body"]
