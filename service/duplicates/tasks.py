"""Laying one mesh onto another, in the workers."""

from core.mesh import Mesh
from core.outline import outline
from core.parameters import Parameters
from core.pipeline import Pipeline
from core.records import embedding_from_bytes
from core.rigid import Alignment, align


def aligned(
    first: Mesh, second: Mesh, first_record: bytes, second_record: bytes, parameters: Parameters
) -> Alignment:
    """The best similarity of two meshes, begun from what their embeddings say corresponds as well."""
    one, other = embedding_from_bytes(first_record), embedding_from_bytes(second_record)
    pairs = Pipeline(parameters).match(one, other).correspondence
    ends = one.positions[pairs[:, 0]].astype("float64"), other.positions[pairs[:, 1]].astype("float64")
    return align(outline(first), outline(second), ends)
