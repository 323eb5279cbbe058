"""The paper's figures: meshes, matches and scores in, pictures and a page out."""

__all__ = ["classes", "page", "retrieval", "spectral"]
