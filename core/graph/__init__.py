"""The mesh as a graph (section 3.3, Eq. 13, Algorithm 2).

A mesh and its samples in, sparse graph, spanning tree and distances out.
"""

__all__ = ["edge_graph", "geodesics", "minimum_spanning_tree", "sparse_graph"]
