"""Registration and dense correspondence of two surfaces, in the workers."""

from io import BytesIO
from typing import Any

import numpy as np

from core.embedding import DenseCorrespondence
from core.mesh.mesh import Mesh
from core.numerics.guarding import guarded
from core.parameters import Parameters
from core.pipeline import Pipeline
from core.registration.probed_surface import probed_surface
from core.registration.rigid_copy import RigidCopy, copy_by_surfaces
from core.serialization import embedding_from_bytes


def registered(
    first: Mesh,
    second: Mesh,
    first_record: bytes,
    second_record: bytes,
    parameters: Parameters,
    variants: bool = True,
) -> RigidCopy | None:
    """The second mesh as a rigid copy of the first or, if `variants` are wanted, as a variant of it.

    See `core.registration.rigid_copy`.
    """
    with guarded():
        one, other = embedding_from_bytes(first_record), embedding_from_bytes(second_record)
        pairs = Pipeline(parameters).match(one, other).correspondence
        ends = one.positions[pairs[:, 0]].astype("float64"), other.positions[pairs[:, 1]].astype("float64")
        return copy_by_surfaces(probed_surface(first), probed_surface(second), ends, variants=variants)


def dense_correspondence(
    first: Mesh, second: Mesh, first_record: bytes, second_record: bytes, parameters: Parameters
) -> tuple[DenseCorrespondence, DenseCorrespondence]:
    """Both ways; see `core.pipeline.Pipeline.correspond_both`."""
    embeddings = embedding_from_bytes(first_record), embedding_from_bytes(second_record)
    return Pipeline(parameters).correspond_both(first, second, embeddings)


def archive(way: DenseCorrespondence) -> bytes:
    """A correspondence as a NumPy archive (npz)."""
    arrays: dict[str, Any] = {
        "vertices": way.vertices,
        "confidence": way.confidence,
        "stretch": way.stretch,
        "partnered": way.partnered,
    }
    if way.displacement is not None:
        arrays["displacement"] = way.displacement
    file = BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()
