"""Rendering: meshes in; thumbnails and GLB files out."""

__all__ = ["colours", "tasks", "thumbnail"]
