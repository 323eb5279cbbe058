"""The method: meshes in, embeddings and matches out. Pure functions of arrays."""
