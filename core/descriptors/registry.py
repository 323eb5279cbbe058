"""The table of descriptors: what each is computed from, its arrays, and its distance.

An embedding holds one array for each descriptor, by name. Records, their checks, caches and the differences
that `combined` reads go by this table.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes, Float32s, Floats
from core.descriptors.facts import intrinsic_reliability
from core.descriptors.partial import ROW_COUNTS, ROW_LENGTH, describe, whole_distances
from core.descriptors.views import VIEW_BYTES, view_descriptor, view_distance
from core.embedding import Embedding
from core.mesh.mesh import Mesh
from core.parameters import INCOMPLETE


@dataclass(frozen=True, eq=False)
class DescribedSurface:
    """The forms of one surface that descriptors are computed from.

    Attributes
    ----------
    cleaned : Mesh
        The mesh of the file, clean.
    prepared : Mesh
        The surface that is sampled: holes closed, simplified, smoothed, in its normal frame.
    opened : callable
        Returns the prepared surface with its boundary loops open.
    smoothed : bool
        Whether the prepared surface was smoothed, since the file's is noisy.
    boundary_ratio : float
        See `core.descriptors.facts.boundary_ratio`.
    """

    cleaned: Mesh
    prepared: Mesh
    opened: Callable[[], Mesh]
    smoothed: bool
    boundary_ratio: float


@dataclass(frozen=True)
class Descriptor:
    """One descriptor of a surface.

    Attributes
    ----------
    shapes : tuple
        The shapes that its array may have.
    dtype : type
        Of its array.
    compute : callable
        Returns the array of a surface.
    distance : callable
        Returns the distances between the array of one surface and those of c others, shape (c,), >= 0.
    typical : float
        The typical distance of shapes that are near by eigenvalues or views; it stands for unknown distances.
    """

    shapes: tuple[tuple[int, ...], ...]
    dtype: type[np.generic]
    compute: Callable[[DescribedSurface], NDArray[Any]]
    distance: Callable[[NDArray[Any], Sequence[NDArray[Any]]], Floats]
    typical: float


def _spin_images(surface: DescribedSurface) -> Bytes:
    """Return spin images; incomplete surfaces are described without filling their holes."""
    is_incomplete = surface.boundary_ratio > INCOMPLETE
    mesh = surface.opened() if is_incomplete else surface.prepared
    return describe(mesh, boundary_ratio=surface.boundary_ratio)


def _views(surface: DescribedSurface) -> Bytes:
    """Return views of the surface as it is; noise turns normals, so noisy surfaces are smoothed first."""
    mesh = surface.opened() if surface.smoothed else surface.cleaned
    return view_descriptor(mesh.vertices, mesh.faces)


DESCRIPTORS: dict[str, Descriptor] = {
    "spin_images": Descriptor(
        shapes=tuple((rows, ROW_LENGTH) for rows in ROW_COUNTS.values()),
        dtype=np.uint8,
        compute=_spin_images,
        distance=whole_distances,
        typical=2.0,
    ),
    "views": Descriptor(
        shapes=((VIEW_BYTES,),),
        dtype=np.uint8,
        compute=_views,
        distance=lambda query, others: view_distance(
            query, np.array(others, np.uint8).reshape(-1, VIEW_BYTES)
        ),
        typical=0.76,
    ),
}
"""The descriptors by name. An embedding changes with this table: raise `core.parameters.METHOD_VERSION`."""


@dataclass(frozen=True, eq=False)
class ShapeDescriptors:
    """The parts of an embedding that are compared beside its spectra.

    Attributes
    ----------
    signature : float32, shape (s,)
    arrays : dict
        An array for each of `DESCRIPTORS`, by name.
    reliability : float
        `core.descriptors.facts.intrinsic_reliability`, in (0, 1].
    """

    signature: Float32s
    arrays: dict[str, NDArray[Any]]
    reliability: float

    @property
    def nbytes(self) -> int:
        """Memory of the arrays, in bytes."""
        return self.signature.nbytes + sum(array.nbytes for array in self.arrays.values())


def compute_descriptors(surface: DescribedSurface) -> dict[str, NDArray[Any]]:
    """Return the array of each of `DESCRIPTORS`, by name; raise DegenerateMeshError if there is no area."""
    return {name: descriptor.compute(surface) for name, descriptor in DESCRIPTORS.items()}


def descriptors_of(embedding: Embedding) -> ShapeDescriptors:
    """Return the descriptors of an embedding."""
    reliability = intrinsic_reliability(embedding.facts)
    return ShapeDescriptors(embedding.signature, embedding.descriptors, reliability)


def descriptor_distances(query: ShapeDescriptors, others: Sequence[ShapeDescriptors]) -> dict[str, Floats]:
    """Return the distances of each descriptor between one shape and c others, shape (c,), by name."""
    return {
        name: descriptor.distance(query.arrays[name], [other.arrays[name] for other in others])
        for name, descriptor in DESCRIPTORS.items()
    }
