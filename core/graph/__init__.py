"""Graphs on the mesh and on its samples (section 3.3, Eq. 13, Algorithm 2).

A mesh in; its edge graph, geodesic distances, farthest points, and the sparse graph of the samples out.
"""

__all__ = ["bridges", "edge_graph", "geodesics", "sparse_graph"]
