"""Alignment of two meshes, in the workers."""

from core.mesh.mesh import Mesh
from core.parameters import Parameters
from core.pipeline import Pipeline
from core.registration.similarity_icp import Alignment, align
from core.sampling.surface_samples import surface_samples
from core.serialization import embedding_from_bytes


def aligned(
    first: Mesh, second: Mesh, first_record: bytes, second_record: bytes, parameters: Parameters
) -> Alignment:
    """The best similarity transform between two meshes; their correspondence is one of the starts."""
    one, other = embedding_from_bytes(first_record), embedding_from_bytes(second_record)
    pairs = Pipeline(parameters).match(one, other).correspondence
    ends = one.positions[pairs[:, 0]].astype("float64"), other.positions[pairs[:, 1]].astype("float64")
    return align(surface_samples(first), surface_samples(second), ends)
