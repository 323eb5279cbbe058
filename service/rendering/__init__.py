"""Pictures: a mesh in, a thumbnail, a drawing or a GLB out."""

__all__ = ["colours", "drawing", "glb", "tasks", "thumbnail", "viewpoint"]
