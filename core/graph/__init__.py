"""Graphs on the mesh and on its samples (section 3.3, Eq. 13, Algorithm 2).

A mesh and its samples in; the sparse graph, its minimum spanning tree and path lengths out.
"""

__all__ = ["bridges", "edge_graph", "geodesics", "minimum_spanning_tree", "sample_distances", "sparse_graph"]
