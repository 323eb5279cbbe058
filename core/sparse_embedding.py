"""The sparse spectral embedding of a mesh, step by step (section 3 of the paper)."""

import numpy as np

from core.arrays import Bytes
from core.descriptors.completeness import INCOMPLETE
from core.descriptors.descriptor_distance import describe
from core.descriptors.facts import measure
from core.descriptors.global_descriptors import GLOBAL_WEIGHT, global_descriptors
from core.descriptors.view_descriptor import view_descriptor
from core.embedding import Embedding, Facts
from core.graph.bridges import component_bridges
from core.graph.edge_graph import edge_graph
from core.graph.sparse_graph import sample_distances, sparse_graph
from core.mesh.cleaning import Cleaned, vertex_areas
from core.mesh.mesh import Mesh
from core.mesh.preparation import PreparedSurface, nearest_vertices, open_surface, prepared_surface
from core.numerics.guarding import check_finite, guarded
from core.parameters import Parameters
from core.sampling.sampling import embedded_points, least_vertices
from core.spectral.spectral_embedding import SampledSurface, spectra_of


def normalised(mesh: Mesh, parameters: Parameters) -> PreparedSurface:
    """The mesh that is sampled: see `core.mesh.preparation.prepared_surface`."""
    return prepared_surface(mesh, parameters.mesh, least_vertices(parameters))


def opened(cleaned: Cleaned, parameters: Parameters) -> Mesh:
    """A cleaned mesh with its boundary loops open: see `core.mesh.preparation.open_surface`."""
    return open_surface(cleaned, parameters.mesh, least_vertices(parameters))


def embed(mesh: Mesh, parameters: Parameters) -> Embedding:
    """The sparse spectral embedding of a mesh.

    Raises
    ------
    DegenerateMeshError
        The mesh has no area, or too few vertices for the dimensions.
    CannotBeEmbeddedError
        The method fails on the mesh, for example by a division by zero.
    """
    with guarded():
        surface, cleaned, frame, smoothed = normalised(mesh, parameters)
        bridges = component_bridges(surface)
        graph = edge_graph(surface, bridges, unfold=parameters.spectral.unfold)
        points, count = embedded_points(surface, graph, parameters)
        samples = points[:count]
        sparse = sparse_graph(graph, samples)
        areas = np.bincount(
            sparse.regions, weights=vertex_areas(surface.vertices, surface.faces), minlength=count
        )
        embedded = SampledSurface(
            vertices=points,
            distances=sample_distances(graph, points, samples, sparse, parameters.spectral.distances),
            areas=areas / areas.sum(),
            regions=sparse.regions,
            bridges=bridges,
        )
        check_finite(embedded.distances, embedded.areas)
        spectra, signature, orientation = spectra_of(surface, embedded, parameters.spectral)
        signature = np.concatenate([signature, GLOBAL_WEIGHT * global_descriptors(surface)])
        facts = measure(mesh, cleaned, frame)
        spin_images = _spin_images(surface, cleaned, facts, parameters)
        views = _views(cleaned, parameters, smoothed=smoothed)
    positions = frame.invert(surface.vertices[samples])
    return Embedding(
        fingerprint=parameters.fingerprint,
        facts=facts,
        positions=positions.astype(np.float32),
        vertices=nearest_vertices(mesh.vertices, positions).astype(np.int32),
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


def _spin_images(surface: Mesh, cleaned: Cleaned, facts: Facts, parameters: Parameters) -> Bytes:
    """Spin images; incomplete surfaces are described without filling their holes."""
    if facts.boundary_ratio > INCOMPLETE:
        surface = opened(cleaned, parameters)
    return describe(surface, boundary_ratio=facts.boundary_ratio)


def _views(cleaned: Cleaned, parameters: Parameters, *, smoothed: bool) -> Bytes:
    """Views of the surface as it is; noise turns normals, so rough surfaces are smoothed before."""
    surface = opened(cleaned, parameters) if smoothed else cleaned.mesh
    return view_descriptor(surface.vertices, surface.faces)
