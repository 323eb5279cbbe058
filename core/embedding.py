"""What the pipeline makes of a mesh, and what it says of two."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Int32s

NO_SPIN_IMAGES: NDArray[np.uint8] = np.empty((0, 0), dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One spectral embedding of the samples.

    Attributes
    ----------
    name : str
        Which operator it comes from: "affinity" or "laplace-beltrami".
    eigenvalues : float32, shape (s,)
        In the operator's own order: falling magnitude for an affinity, rising for a Laplacian.
    coordinates : float32, shape (d, k)
        Row i is point i in the k-dimensional spectral domain; the first m are the samples.
    """

    name: str
    eigenvalues: Float32s
    coordinates: Float32s


@dataclass(frozen=True)
class Facts:
    """What was measured on the mesh, in the units of the file.

    Attributes
    ----------
    vertices, faces : int
        Counts in the file as it was read.
    area : float
        Surface area.
    volume : float
        Magnitude of the signed volume; of little meaning when the mesh is not watertight.
    scale : float
        Area-weighted root mean square distance of the surface from its centroid: the length that
        becomes 1 in the normal frame.
    components : int
        Connected components, after merging vertices that coincide.
    merged_vertices, dropped_faces : int
        Vertices merged with another, and degenerate or repeated faces dropped, by cleaning.
    boundary_edges, nonmanifold_edges : int
        Edges with one face, and with more than two.
    openness : float
        See `core.descriptors.boundary_ratio`. Embeddings of before it was measured have 0.
    """

    vertices: int
    faces: int
    area: float
    volume: float
    scale: float
    components: int
    merged_vertices: int
    dropped_faces: int
    boundary_edges: int
    nonmanifold_edges: int
    openness: float = 0.0


@dataclass(frozen=True, eq=False)
class Embedding:
    """All that is kept of a shape for matching it and for drawing the match.

    Attributes
    ----------
    fingerprint : str
        Of the parameters and the method version that made it. Only embeddings of one fingerprint are
        compared.
    facts : Facts
        Measured on the mesh.
    positions : float32, shape (m, 3)
        The samples in the file's own frame and units.
    vertices : int32, shape (m,)
        The file's vertex at each sample, or the nearest one where the sample lies on a subdivided edge.
    graph_edges : int32, shape (e, 2)
        The sparse graph on the samples, i < j.
    graph_lengths : float32, shape (e,)
        Length of each edge, in units of `facts.scale`.
    tree_edges : int32, shape (m - 1, 2)
        The minimum spanning tree, part of the graph.
    regions : int32, shape (d,)
        The sample nearest to each embedded point; the first m points are the samples themselves.
    signature : float32, shape (s,)
        What shapes are shortlisted by; compared by Euclidean distance.
    spectra : tuple of Spectrum
        One or several embeddings of the same points.
    patches : uint8, shape (r, w)
        What lies about points of the surface: see `core.descriptors.descriptor_distance`. Of shape (0, 0) where the parameters
        ask for none.
    """

    fingerprint: str
    facts: Facts
    positions: Float32s
    vertices: Int32s
    graph_edges: Int32s
    graph_lengths: Float32s
    tree_edges: Int32s
    regions: Int32s
    signature: Float32s
    spectra: tuple[Spectrum, ...]
    spin_images: NDArray[np.uint8] = field(default_factory=lambda: NO_SPIN_IMAGES)


@dataclass(frozen=True, eq=False)
class Scores:
    """How alike one shape is to each of c others.

    Attributes
    ----------
    cc : float64, shape (c,)
        Correlation coefficient of matched spectral coordinates, in [-1, 1]; 1 for a shape against itself.
    ssd : float64, shape (c,)
        Sum of squared differences (Eq. 18), >= 0; 0 for a shape against itself.
    sim : float64, shape (c,)
        Effective pairs over the smaller number of samples (Eq. 20), each partner counted once, the mean of
        both ways; in [0, 1].
    """

    cc: NDArray[np.float64]
    ssd: NDArray[np.float64]
    sim: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Match:
    """Two shapes compared, with the correspondence.

    Attributes
    ----------
    cc, ssd, sim : float
        As in `Scores`.
    correspondence : int32, shape (p, 2)
        Pairs (sample of the first shape, sample of the second).
    distances : float32, shape (p,)
        Distance between the two points of each pair in the first spectral domain, under the warp that sim
        reads.
    effective : bool, shape (p,)
        Whether that distance is at most gamma (below Eq. 19) and the pair one-to-one.
    """

    cc: float
    ssd: float
    sim: float
    correspondence: Int32s
    distances: Float32s = field(repr=False)
    effective: NDArray[np.bool_] = field(repr=False)


EmbeddedPoints = tuple[tuple[Float32s, ...], Int32s]
"""Coordinates in each spectral domain, (d, k), and the sample nearest to each of the d points, (d,)."""
