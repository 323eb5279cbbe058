"""The sparse spectral embedding of a mesh, step by step (section 3 of the paper)."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from core.descriptors.facts import GLOBAL_WEIGHT, global_descriptors, measure
from core.descriptors.pieces import pieces
from core.descriptors.registry import DESCRIPTORS, DescribedSurface, computed_descriptors
from core.embedding import Embedding
from core.graph.bridges import component_bridges
from core.graph.edge_graph import edge_graph
from core.graph.sparse_graph import sample_distances, sparse_graph
from core.matching.quantised_points import rounded
from core.mesh.cleaning import Cleaned, vertex_areas
from core.mesh.mesh import Mesh
from core.mesh.preparation import PreparedSurface, nearest_vertices, open_surface, prepared_surface
from core.numerics.guarding import check_finite, guarded
from core.parameters import Parameters
from core.sampling.sampling import embedded_points, least_vertices
from core.spectral.spectral_embedding import SampledSurface, spectra_of


def prepared(mesh: Mesh, parameters: Parameters) -> PreparedSurface:
    """Return the surface that is sampled: see `core.mesh.preparation.prepared_surface`."""
    return prepared_surface(mesh, parameters.mesh, least_vertices(parameters))


def opened(cleaned: Cleaned, parameters: Parameters) -> Mesh:
    """Return a cleaned mesh with its boundary loops open: see `core.mesh.preparation.open_surface`."""
    return open_surface(cleaned, parameters.mesh, least_vertices(parameters))


def embed(mesh: Mesh, parameters: Parameters, descriptors: Iterable[str] | None = None) -> Embedding:
    """Compute the sparse spectral embedding of a mesh: see `core.pipeline.Pipeline.embed`."""
    with guarded():
        # Clean, close holes, simplify or refine, smooth; unit scale.
        surface, cleaned, frame, smoothed = prepared(mesh, parameters)
        bridges = component_bridges(surface)
        graph = edge_graph(surface, bridges, unfold=parameters.spectral.unfold)

        # Sample by Lewis weights; each vertex belongs to the region of the nearest sample.
        points, count = embedded_points(surface, graph, parameters)
        samples = points[:count]
        sparse = sparse_graph(graph, samples)
        vertex_shares = vertex_areas(surface.vertices, surface.faces)
        areas = np.bincount(sparse.regions, weights=vertex_shares, minlength=count)
        sampled = SampledSurface(
            vertices=points,
            distances=sample_distances(graph, points, samples, sparse, parameters.spectral.distances),
            areas=areas / areas.sum(),
            regions=sparse.regions,
            bridges=bridges,
        )
        check_finite(sampled.distances, sampled.areas)

        # Embed in the spectral domains; describe the surface beside them.
        spectra, eigenvalues, orientation, many = spectra_of(surface, sampled, parameters.spectral)
        signature = np.concatenate([eigenvalues, GLOBAL_WEIGHT * global_descriptors(surface)])
        facts = measure(mesh, cleaned, frame)
        described = DescribedSurface(
            cleaned=cleaned.mesh,
            prepared=surface,
            opened=lambda: opened(cleaned, parameters),
            smoothed=smoothed,
            boundary_ratio=facts.boundary_ratio,
            eigenvalues=many,
        )
        names = computed_descriptors() if descriptors is None else descriptors
        arrays = {name: DESCRIPTORS[name].compute(described) for name in names}

        # Round coordinates, which must be finite.
        regions = sparse.regions[points].astype(np.int32)
        spectra = tuple(
            replace(spectrum, coordinates=rounded(spectrum.coordinates, regions)) for spectrum in spectra
        )
    positions = frame.invert(surface.vertices[samples])
    return Embedding(
        fingerprint=parameters.fingerprint,
        facts=facts,
        positions=positions.astype(np.float32),
        vertices=nearest_vertices(mesh.vertices, positions).astype(np.int32),
        graph_edges=sparse.edges.astype(np.int32),
        graph_lengths=sparse.lengths.astype(np.float32),
        tree_edges=sparse.edges[sparse.tree].astype(np.int32),
        regions=regions,
        signature=signature.astype(np.float32),
        spectra=spectra,
        pieces=pieces(cleaned.mesh, cleaned.labels),
        descriptors={name: array for name, array in arrays.items() if array is not None},
        orientation=orientation,
    )
