"""Pictures of stored shapes over HTTP: ids and files in, thumbnails and GLB previews out."""

__all__ = ["endpoints", "thumbnails"]
