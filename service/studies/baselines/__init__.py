"""Other methods of comparing shapes, by outside libraries: meshes in, distances out."""

__all__ = ["methods", "scoring"]
