"""The whole method: a mesh to its embedding, two embeddings to their match."""

from collections.abc import Sequence
from operator import attrgetter

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from core.arrays import Bytes, Floats, Int8s, Ints
from core.dense.dense_correspondence import correspond
from core.dense.records import DenseCorrespondence
from core.dense.working_surface import WorkingSurface, working_surface
from core.descriptors.boundary_ratio import boundary_ratio
from core.descriptors.completeness import INCOMPLETE
from core.descriptors.descriptor_distance import DescriptorDistance, describe, descriptor_distance
from core.descriptors.global_descriptors import GLOBAL_WEIGHT, global_descriptors, signed_volume
from core.descriptors.view_descriptor import view_descriptor
from core.embedding import NO_SPIN_IMAGES, NO_VIEWS, Embedding, Facts, Match, Scores
from core.errors import DegenerateMeshError, IncompatibleEmbeddingsError
from core.graph.edge_graph import edge_graph
from core.graph.geodesics import geodesics
from core.graph.minimum_spanning_tree import tree_distances
from core.graph.sparse_graph import SparseGraph, graph_distances, sparse_graph
from core.matching.matcher import Prepared, embedding_key
from core.matching.matcher_choice import matcher_of
from core.mesh.cleaning import Cleaned, clean, face_areas, vertex_areas
from core.mesh.denoising import roughness, taubin_smoothing
from core.mesh.hole_filling import fill_holes
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import NormalFrame, normal_frame
from core.mesh.simplification import simplify
from core.mesh.subdivision import refine
from core.numerics.guarding import check_finite, guarded
from core.parameters import DEFAULT, Parameters
from core.ranking.class_probability import class_probability, signature_features
from core.ranking.evidence import descriptors_of, evidence_of
from core.ranking.local_density import LocalDensities
from core.ranking.opinion_pool import pooled_probability
from core.sampling.lewis_weights import lewis_weights
from core.sampling.sampling import keyed_uniform, random_draw, sort_and_cut, weighted_farthest_points
from core.spectral.spectral_embedding import SampledSurface, spectra_of

PREPARED_BYTES = 128 * 1024 * 1024
"""The most bytes of prepared shapes that a pipeline caches, unless another number is given."""


MAPS = 2
"""The most maps of samples that a dense correspondence begins from."""


def _orientations(first: Embedding, second: Embedding) -> tuple[Int8s, Int8s] | None:
    """The orientations of two embeddings, if both have one."""
    if not (first.orientation.size and second.orientation.size):
        return None
    return first.orientation, second.orientation


def measure(mesh: Mesh, cleaned: Cleaned, frame: NormalFrame, *, pieces: bool) -> Facts:
    """Measurements of a mesh, from the mesh as read, the cleaned mesh and its normal frame.

    `pieces` is that of `core.descriptors.boundary_ratio`.
    """
    faces = cleaned.mesh.faces
    volume = signed_volume(frame.apply(cleaned.mesh.vertices), faces)
    face_counts = cleaned.sides.face_counts
    area = float(face_areas(cleaned.mesh.vertices, faces).sum())
    return Facts(
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        area=area,
        volume=float(abs(volume) * frame.scale**3),
        scale=frame.scale,
        components=cleaned.components,
        merged_vertices=cleaned.merged_vertices,
        dropped_faces=cleaned.dropped_faces,
        boundary_edges=int((face_counts == 1).sum()),
        nonmanifold_edges=int((face_counts > 2).sum()),
        openness=boundary_ratio(cleaned.mesh, cleaned.sides, area, pieces=pieces),
    )


class Pipeline:
    """The method under one set of parameters.

    The same mesh gives the same bytes in every process; linear algebra runs on one thread for this reason.

    Parameters
    ----------
    parameters : Parameters, optional
        Frozen; `DEFAULT` unless given. `fingerprint` is a hash of them and of the method version.
    memory : int
        The most bytes of prepared shapes that are cached; the least recently used ones are evicted.
    """

    def __init__(self, parameters: Parameters = DEFAULT, *, memory: int = PREPARED_BYTES) -> None:
        self.parameters = parameters
        self.fingerprint = parameters.fingerprint
        self.matcher = matcher_of(parameters)
        self._prepared: LRUCache[bytes, Prepared] = LRUCache(memory, getsizeof=attrgetter("nbytes"))

    def normalise(self, mesh: Mesh) -> tuple[Mesh, Cleaned, NormalFrame]:
        """The mesh that is sampled, the cleaned mesh and the normal frame.

        The sampled mesh is clean, has its holes filled, is in its normal frame, and is simplified, smoothed
        and refined as the parameters ask.

        Raises
        ------
        DegenerateMeshError
            The mesh has no area.
        """
        wanted = self.parameters.mesh
        cleaned = clean(mesh)
        surface = cleaned.mesh
        if wanted.fill_holes:
            surface = fill_holes(surface, wanted.fill_holes, cleaned.sides)
        frame = normal_frame(surface)
        normal = self._simplified_and_smoothed(Mesh(frame.apply(surface.vertices), surface.faces))
        return self._refined(normal), cleaned, frame

    def _simplified_and_smoothed(self, normal: Mesh) -> Mesh:
        """Simplify a large mesh and smooth a rough one; the mesh is in its normal frame."""
        wanted = self.parameters.mesh
        if wanted.decimate_above and len(normal.vertices) > wanted.decimate_above:
            normal = simplify(normal, wanted.decimate_to)
        return taubin_smoothing(normal, wanted.smooth_rounds) if self._is_rough(normal) else normal

    def _is_rough(self, normal: Mesh) -> bool:
        most = self.parameters.mesh.smooth_above
        if not most or roughness(normal) <= most:
            return False
        return not self.parameters.mesh.smooth_refined or roughness(self._refined(normal)) > most

    def _refined(self, normal: Mesh) -> Mesh:
        """Split long edges of a mesh with too few vertices."""
        needed = max(self.parameters.mesh.refine_vertices, self._least_vertices())
        return refine(normal, needed) if len(normal.vertices) < needed else normal

    def open_surface(self, mesh: Mesh) -> Mesh:
        """The mesh, clean, simplified and smoothed, in its normal frame, with its boundary loops open.

        Raises
        ------
        DegenerateMeshError
            The mesh has no area.
        """
        with guarded():
            return self._open_surface(clean(mesh))

    def _open_surface(self, cleaned: Cleaned) -> Mesh:
        frame = normal_frame(cleaned.mesh)
        return self._simplified_and_smoothed(Mesh(frame.apply(cleaned.mesh.vertices), cleaned.mesh.faces))

    def spin_images_of(self, mesh: Mesh) -> Bytes:
        """The spin images of a mesh, also if the parameters leave them out of embeddings.

        Returns
        -------
        uint8, shape (r, ROW_LENGTH)
            From `core.descriptors.descriptor_distance.describe`.

        Raises
        ------
        DegenerateMeshError
            The mesh has no area.
        """
        with guarded():
            surface, cleaned, frame = self.normalise(mesh)
            return self._spin_images(surface, cleaned, self._facts(mesh, cleaned, frame))

    def _facts(self, mesh: Mesh, cleaned: Cleaned, frame: NormalFrame) -> Facts:
        return measure(mesh, cleaned, frame, pieces=self.parameters.ranking.views)

    def _spin_images(self, surface: Mesh, cleaned: Cleaned, facts: Facts) -> Bytes:
        """Spin images; incomplete surfaces are described without filling their holes."""
        if facts.openness > INCOMPLETE:
            surface = self._open_surface(cleaned)
        return describe(surface, boundary_ratio=facts.openness)

    def _least_vertices(self) -> int:
        """Least number of vertices for the samples, and for the eigenvalues of the signature.

        `refine` leaves edges up to 1.5 times the even side, so it may make 2.25 times fewer vertices than
        asked.
        """
        wanted, spectral = self.parameters.sampling, self.parameters.spectral
        samples = max(spectral.dimensions + 2, spectral.affinity_values)
        asked = wanted.samples or int(np.ceil(samples / wanted.tau))
        return int(np.ceil(2.5 * max(asked, samples, spectral.laplacian_values + 2)))

    def sample(self, mesh: Mesh, graph: csr_array) -> tuple[Ints, int]:
        """The vertices that are embedded, int64, shape (d,), and the number m of samples, which come first.

        Parameters
        ----------
        mesh : Mesh
            In its normal frame, with n vertices.
        graph : csr_array, shape (n, n)
            Its edge graph.

        Raises
        ------
        DegenerateMeshError
            The mesh has too few vertices for the dimensions.
        """
        wanted, spectral = self.parameters.sampling, self.parameters.spectral
        count = wanted.samples or round(wanted.tau * len(mesh.vertices))
        count = min(count, wanted.sample_cap or count, len(mesh.vertices))
        if count < spectral.dimensions + 2:
            raise DegenerateMeshError(f"only {count} samples for {spectral.dimensions} dimensions")
        drawn = wanted.selection == "random-draw"
        weights = lewis_weights(
            mesh.vertices,
            degree=wanted.degree,
            epsilon=wanted.epsilon,
            normalise=wanted.normalise_weights,
            random=keyed_uniform(mesh.vertices, wanted.seed + 1) if drawn else None,
        ).weights
        if wanted.selection == "sort-and-cut":
            return sort_and_cut(weights, count), count
        if drawn:
            return random_draw(weights, count, keyed_uniform(mesh.vertices, wanted.seed)), count
        more = spectral.distances == "geodesic" and spectral.affinity == "gaussian"
        points = min(max(wanted.points if more else 0, count), len(mesh.vertices))
        return weighted_farthest_points(graph, mesh.vertices, weights, points, wanted.coverage_power), count

    def distances(self, graph: csr_array, points: Ints, samples: Ints, sparse: SparseGraph) -> Floats:
        """Distances from the d points to the m samples, shape (d, m), by the parameter `distances`.

        Distances along the minimum spanning tree or the sparse graph exist between samples only (d = m).

        Parameters
        ----------
        graph : csr_array, shape (n, n)
            The edge graph.
        points : int64, shape (d,)
            Vertices; the samples come first.
        samples : int64, shape (m,)
            Vertices.
        sparse : SparseGraph
            The sparse graph of the samples.
        """
        if self.parameters.spectral.distances == "geodesic":
            between = geodesics(graph, samples, points)
            core = between[: len(samples)]
            core[:] = np.minimum(core, core.T)
            return between
        along = tree_distances if self.parameters.spectral.distances == "tree" else graph_distances
        return along(sparse, len(samples))

    def embed(self, mesh: Mesh) -> Embedding:
        """The sparse spectral embedding of a mesh (section 3 of the paper).

        Raises
        ------
        DegenerateMeshError
            The mesh has no area, or too few vertices for the dimensions.
        CannotBeEmbeddedError
            The method fails on the mesh, for example by a division by zero.
        """
        with guarded():
            surface, cleaned, frame = self.normalise(mesh)
            graph = edge_graph(surface, unfold=self.parameters.spectral.unfold)
            points, count = self.sample(surface, graph)
            samples = points[:count]
            sparse = sparse_graph(graph, samples)
            areas = np.bincount(
                sparse.regions, weights=vertex_areas(surface.vertices, surface.faces), minlength=count
            )
            embedded = SampledSurface(
                vertices=points,
                distances=self.distances(graph, points, samples, sparse),
                areas=areas / areas.sum(),
                regions=sparse.regions,
            )
            check_finite(embedded.distances, embedded.areas)
            spectra, signature, orientation = spectra_of(surface, embedded, self.parameters.spectral)
            if self.parameters.ranking.global_descriptors:
                signature = np.concatenate([signature, GLOBAL_WEIGHT * global_descriptors(surface)])
            facts = self._facts(mesh, cleaned, frame)
            spin_images = (
                self._spin_images(surface, cleaned, facts)
                if self.parameters.ranking.spin_images
                else NO_SPIN_IMAGES
            )
            views = (
                view_descriptor(cleaned.mesh.vertices, cleaned.mesh.faces)
                if self.parameters.ranking.views
                else NO_VIEWS
            )
        positions = frame.invert(surface.vertices[samples])
        return Embedding(
            fingerprint=self.fingerprint,
            facts=facts,
            positions=positions.astype(np.float32),
            vertices=np.asarray(cKDTree(mesh.vertices).query(positions)[1]).astype(np.int32),
            graph_edges=sparse.edges.astype(np.int32),
            graph_lengths=sparse.lengths.astype(np.float32),
            tree_edges=sparse.edges[sparse.tree].astype(np.int32),
            regions=sparse.regions[points].astype(np.int32),
            signature=signature.astype(np.float32),
            spectra=spectra,
            spin_images=spin_images,
            views=views,
            orientation=orientation,
        )

    def prepared(self, embedding: Embedding) -> Prepared:
        """The embedding as the matcher reads it, its splines factored; cached."""
        key = embedding_key(embedding)
        ready = self._prepared.get(key)
        if ready is None:
            ready = self.matcher.prepare(embedding, key)
            if ready.nbytes <= self._prepared.maxsize:
                self._prepared[key] = ready
        return ready

    def _checked(self, embedding: Embedding) -> Prepared:
        """The embedding as the matcher reads it, if this pipeline made it."""
        if embedding.fingerprint != self.fingerprint:
            raise IncompatibleEmbeddingsError(
                f"embedding {embedding.fingerprint} under pipeline {self.fingerprint}"
            )
        return self.prepared(embedding)

    def score(self, query: Embedding, candidates: Sequence[Embedding]) -> Scores:
        """CC, SSD and sim of one shape with each of several: the means over their spectra.

        Raises
        ------
        IncompatibleEmbeddingsError
            An embedding was made with other parameters.
        """
        with guarded():
            prepared = self._checked(query)
            return self.matcher.score(prepared, (self._checked(candidate) for candidate in candidates))

    def match(self, first: Embedding, second: Embedding) -> Match:
        """Two shapes compared: the scores of `score`, and the correspondence.

        Raises
        ------
        IncompatibleEmbeddingsError
            An embedding was made with other parameters.
        """
        with guarded():
            orientations = _orientations(first, second)
            found = self.matcher.match(self._checked(first), self._checked(second), orientations)
            check_finite(found.cc, found.ssd, found.sim, found.distances)
        return Match(
            cc=found.cc,
            ssd=found.ssd,
            sim=found.sim,
            correspondence=found.pairs.astype(np.int32),
            distances=found.distances.astype(np.float32),
            effective=found.effective,
            mirrored=found.mirrored,
        )

    def correspondences(self, first: Embedding, second: Embedding) -> tuple[list[Ints], bool | None]:
        """Several correspondences of samples that fit about equally well, at most `MAPS`, best first.

        Returns
        -------
        list of int64, shape (p, 2)
            Pairs (sample of the first shape, sample of the second); a sample may be in several pairs.
        bool or None
            Whether they reverse orientation: see `core.embedding.Match`.

        Raises
        ------
        IncompatibleEmbeddingsError
            An embedding was made with other parameters.
        """
        match = self.match(first, second)
        orientations = _orientations(first, second)
        if orientations is None or match.mirrored is None:
            return [match.correspondence.astype(np.int64)], None
        with guarded():
            prepared = self._checked(first), self._checked(second)
            return self.matcher.candidates(*prepared, orientations, MAPS), match.mirrored

    def correspond(
        self, first: Mesh, second: Mesh, embeddings: tuple[Embedding, Embedding] | None = None
    ) -> DenseCorrespondence:
        """The vertex of the second mesh that corresponds to each vertex of the first.

        Parameters are those of `correspond_both`.
        """
        return self.correspond_both(first, second, embeddings)[0]

    def correspond_both(
        self, first: Mesh, second: Mesh, embeddings: tuple[Embedding, Embedding] | None = None
    ) -> tuple[DenseCorrespondence, DenseCorrespondence]:
        """The dense correspondence from the first mesh to the second, and from the second to the first.

        Parameters
        ----------
        first, second : Mesh
            Above `core.dense.working_surface.MOST_VERTICES` vertices, the correspondence is computed on
            simplified copies.
        embeddings : two Embedding, optional
            Of the two meshes by this pipeline; they are computed unless given.

        Raises
        ------
        DegenerateMeshError
            A mesh has no area, or too few vertices for the dimensions.
        CannotBeEmbeddedError
            The method fails on a mesh.
        IncompatibleEmbeddingsError
            An embedding was made with other parameters.
        """
        one, other = embeddings or (self.embed(first), self.embed(second))
        pairs, mirrored = self.correspondences(one, other)
        with guarded():
            return correspond(self._working(first, one), self._working(second, other), pairs, mirrored)

    def _working(self, mesh: Mesh, embedding: Embedding) -> WorkingSurface:
        surface, _, frame = self.normalise(mesh)
        return working_surface(mesh, surface, frame, embedding.positions.astype(np.float64))

    def features(
        self, cc: Floats, sim: Floats, query: NDArray[np.float32], signatures: NDArray[np.float32]
    ) -> Floats:
        """The features of whole shapes that `combined` reads, shape (c, 2).

        See `core.ranking.class_probability.signature_features`.
        """
        return signature_features(
            cc, sim, query, signatures, global_descriptors=self.parameters.ranking.global_descriptors
        )

    def combined(
        self,
        cc: Floats,
        sim: Floats,
        query: NDArray[np.float32],
        signatures: NDArray[np.float32],
        descriptor_distance: DescriptorDistance | None = None,
    ) -> Floats:
        """The probability that one shape and each of c others are of one class, shape (c,), in [0, 1].

        Calibrated for the default setting; under other parameters only its order has a meaning.

        Parameters
        ----------
        cc, sim : float64, shape (c,)
            As `score` gives them.
        query : float32, shape (s,)
        signatures : float32, shape (c, s)
        descriptor_distance : DescriptorDistance, optional
            Between their spin images. Without it the probability is less exact.
        """
        return class_probability(self.features(cc, sim, query, signatures), descriptor_distance)

    @property
    def pools_experts(self) -> bool:
        """Whether `combined` reads all evidence (`core.ranking.evidence`): embeddings then hold all of it."""
        ranking = self.parameters.ranking
        return ranking.views and ranking.spin_images and ranking.global_descriptors

    def combined_with(
        self,
        query: Embedding,
        others: Sequence[Embedding],
        scores: Scores,
        own: LocalDensities | None = None,
        densities: LocalDensities | None = None,
    ) -> Floats:
        """`combined` of one embedding with c others, shape (c,), from their scores of `score`.

        Parameters
        ----------
        query : Embedding
        others : sequence of Embedding
        scores : Scores
        own, densities : LocalDensities, optional
            Of the query, arrays of shape (1,), and of the others, shape (c,), among the stored shapes; the
            typical ones unless given. Only pipelines that pool experts use them.
        """
        if self.pools_experts:
            described = [descriptors_of(other) for other in others]
            return pooled_probability(evidence_of(descriptors_of(query), described, scores, own, densities))
        signatures = np.array([other.signature for other in others]).reshape(-1, len(query.signature))
        between = (
            descriptor_distance(query.spin_images, [other.spin_images for other in others])
            if query.spin_images.size
            else None
        )
        return self.combined(scores.cc, scores.sim, query.signature, signatures, between)
