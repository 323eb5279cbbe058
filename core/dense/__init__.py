"""Dense correspondence: two meshes and a few pairs in; a vertex for each vertex, and differences, out."""

__all__ = ["confidence", "dense_correspondence", "functional_maps", "transfer", "working_surface"]
