"""Rendering: meshes in; thumbnails and GLB files out."""

__all__ = ["colours", "glb", "tasks", "thumbnail"]
