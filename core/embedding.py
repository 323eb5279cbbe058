"""Results of the pipeline: the embedding of one shape; scores, match and dense correspondence of two."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Floats, Int8s, Int32s

NO_ORIENTATION: Int8s = np.empty((0, 0), dtype=np.int8)


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One spectral embedding of d points of a surface.

    Attributes
    ----------
    name : str
        The operator: "affinity" or "laplace-beltrami".
    eigenvalues : float32, shape (s,)
        By descending magnitude for an affinity, ascending for a Laplacian.
    coordinates : float32, shape (d, k)
        Row i is point i in the k-dimensional spectral domain; the first m points are the samples. Rounded as
        `core.matching.quantised_points` does.
    """

    name: str
    eigenvalues: Float32s
    coordinates: Float32s


@dataclass(frozen=True)
class Facts:
    """Measurements of a mesh, in the units of its file.

    Attributes
    ----------
    vertices, faces : int
        Numbers of vertices and faces in the file.
    area : float
        Surface area.
    volume : float
        Magnitude of the signed volume; it means little if the mesh is not watertight.
    scale : float
        Area-weighted root mean square distance of the surface from its centroid, the unit length of the
        normal frame.
    components : int
        Number of connected components after coincident vertices are merged.
    merged_vertices, dropped_faces : int
        Numbers of vertices that cleaning merged, and of degenerate or repeated faces that it dropped.
    boundary_edges, nonmanifold_edges : int
        Numbers of edges with one face, and with more than two.
    boundary_ratio : float
        In [0, 1]: see `core.descriptors.facts`.
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
    boundary_ratio: float


@dataclass(frozen=True, eq=False)
class Embedding:
    """The sparse spectral embedding of a shape: all data that matching and drawing need.

    Attributes
    ----------
    fingerprint : str
        Hash of the parameters and of the method version. Only embeddings of one fingerprint are compared.
    facts : Facts
        Measurements of the mesh.
    positions : float32, shape (m, 3)
        The samples, in the file's frame and units.
    vertices : int32, shape (m,)
        The file's vertex nearest to each sample; samples may lie on subdivided edges.
    graph_edges : int32, shape (e, 2)
        Edges (i, j) of the sparse graph on the samples, i < j.
    graph_lengths : float32, shape (e,)
        Length of each edge, in units of the root mean square radius of the surface with its holes closed.
    tree_edges : int32, shape (m - 1, 2)
        Edges of the minimum spanning tree of the sparse graph.
    regions : int32, shape (d,)
        The sample nearest to each embedded point; the first m points are the samples themselves.
    signature : float32, shape (s,)
        The vector for the shortlist, compared by Euclidean distance.
    spectra : tuple of Spectrum
        One or several spectral embeddings of the same d points.
    pieces : float32, shape (k, 6)
        The kinds of connected components: see `core.descriptors.pieces`.
    descriptors : dict
        An array for each descriptor, by name, but for optional ones: see `core.descriptors.registry`.
    orientation : int8, shape (m, p)
        Signed areas of the samples' regions from `core.spectral.orientation.quantised_areas`. The shape is
        (0, 0) without Laplace-Beltrami coordinates, and if the surface's faces are turned every way.
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
    pieces: Float32s
    descriptors: dict[str, NDArray[Any]]
    orientation: Int8s = field(default_factory=lambda: NO_ORIENTATION)


@dataclass(frozen=True, eq=False)
class Scores:
    """Similarity of one shape to each of c others.

    Attributes
    ----------
    cc : float64, shape (c,)
        Correlation coefficient of matched spectral coordinates, in [-1, 1]; 1 for a shape against itself.
    ssd : float64, shape (c,)
        Root of the sum of squared differences of matched spectral coordinates, divided by the number of pairs
        (Eq. 18), >= 0; 0 for a shape against itself.
    sim : float64, shape (c,)
        Effective one-to-one pairs over the smaller number of samples (Eq. 20), the mean of both directions;
        in [0, 1].
    """

    cc: NDArray[np.float64]
    ssd: NDArray[np.float64]
    sim: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Match:
    """The scores and the correspondence of two shapes.

    Attributes
    ----------
    cc, ssd, sim : float
        As in `Scores`.
    correspondence : int32, shape (p, 2)
        Pairs (sample of the first shape, sample of the second).
    distances : float32, shape (p,)
        Distance between the two points of each pair in the first spectral domain, under the map that sim
        uses.
    effective : bool, shape (p,)
        Whether that distance is at most gamma (below Eq. 19) and the pair one-to-one.
    mirrored : bool or None
        Whether the second shape is like the mirror image of the first: no correspondence that fits about as
        well preserves orientation. None if correspondences of either orientation fit, as between bodies that
        are nearly their own mirror images; the one that preserves it is then given. None as well if an
        embedding has no orientation; left and right may then be exchanged.
    """

    cc: float
    ssd: float
    sim: float
    correspondence: Int32s
    distances: Float32s = field(repr=False)
    effective: NDArray[np.bool_] = field(repr=False)
    mirrored: bool | None = None

    def points(self, first: Embedding, second: Embedding) -> tuple[Floats, Floats]:
        """Return the positions of the pairs on the two shapes, shape (p, 3) each."""
        ours, theirs = self.correspondence.T
        return first.positions[ours].astype(np.float64), second.positions[theirs].astype(np.float64)

    def swapped(self) -> "Match":
        """Return the same match seen from the other shape."""
        order = np.lexsort((self.correspondence[:, 0], self.correspondence[:, 1]))
        return replace(
            self,
            correspondence=self.correspondence[order][:, ::-1],
            distances=self.distances[order],
            effective=self.effective[order],
        )


@dataclass(frozen=True, eq=False)
class DenseCorrespondence:
    """For each of the n vertices of one mesh its vertex on another mesh, and how the two differ there.

    Attributes
    ----------
    vertices : int32, shape (n,)
        A vertex of the other mesh, as it was given; several vertices may share one.
    confidence : float32, shape (n,)
        Probability, in [0, 1], that the vertex is within 0.05 root of the area of the true one; where rigid
        surfaces coincide, 0.5 to 1 by their distance; 0 where there is no partner.
    stretch : float32, shape (n,)
        Length around the vertex on the other mesh over length here, > 0, divided by its median: 1 where
        the surface is not stretched.
    displacement : float32, shape (n,), or None
        Distance from the partner after the best similarity transform, in units of this mesh; where there is
        no partner, the distance from the other surface. None unless the two are rigid copies in large part.
    partnered : bool, shape (n,)
        Whether the other surface has a corresponding place.
    scale : float
        Length on the other mesh over length on this mesh, > 0.
    maps : int
        Different maps that fit about equally well, this one counted: more than 1 if the shape is symmetric,
        or the shapes are unlike.
    mirrored : bool or None
        Whether the map reverses orientation: the other mesh is like the mirror image of this one, and no map
        that fits about as well preserves orientation. None if orientations are unknown.
    simplified : bool
        Whether the correspondence was computed on simplified copies of the two meshes and transferred.
    """

    vertices: Int32s
    confidence: Float32s
    stretch: Float32s
    displacement: Float32s | None
    partnered: NDArray[np.bool_]
    scale: float
    maps: int
    mirrored: bool | None
    simplified: bool
