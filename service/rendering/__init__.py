"""Rendering: meshes in; thumbnails, drawings and GLB files out."""

__all__ = ["colours", "dense_colours", "drawing", "glb", "tasks", "thumbnail", "viewpoint"]
