"""Rendering: meshes in; thumbnails, drawings and GLB files out."""

__all__ = ["colours", "glb", "tasks", "thumbnail"]
