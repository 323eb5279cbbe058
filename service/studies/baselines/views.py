"""The view descriptor alone: the panoramas and the pair histogram of a surface, whatever its mesh."""

from collections.abc import Sequence

import numpy as np

from core.arrays import Bytes, Floats
from core.descriptors.view_descriptor import view_descriptor, view_distance
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh


def describe(mesh: Mesh) -> Bytes:
    """The view descriptor of the cleaned mesh, shape (VIEW_BYTES,).

    Raises
    ------
    DegenerateMeshError
        The mesh has no area.
    """
    surface = clean(mesh).mesh
    return view_descriptor(surface.vertices, surface.faces)


def compare(description: Bytes, others: Sequence[Bytes]) -> Floats:
    """View distances, shape (c,)."""
    return view_distance(description, np.stack(others))
