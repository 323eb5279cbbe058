"""The table of descriptors: what each is computed from, its arrays, and its distance.

An embedding holds one array for each descriptor, by name. Records, their checks, caches and the differences
that `combined` reads go by this table.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes, Float32s, Floats, Ints
from core.descriptors.eigenvalues import eigenvalue_distance, log_eigenvalues
from core.descriptors.facts import intrinsic_reliability
from core.descriptors.network import FEATURES
from core.descriptors.network_views import VIEWS, is_available, network_view_distance, network_views
from core.descriptors.partial import ROW_COUNTS, ROW_LENGTH, describe, whole_distances
from core.descriptors.view_frames import NormalisedSurface
from core.descriptors.views import VIEW_BYTES, describe_views, view_distance, view_surface
from core.embedding import Embedding
from core.mesh.mesh import Mesh
from core.parameters import INCOMPLETE
from core.spectral.spectral_embedding import SPECTRUM


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
    eigenvalues : float64, shape (at most SPECTRUM,)
        Eigenvalues of the Laplace-Beltrami operator times the area, ascending; none if not asked for.
    """

    cleaned: Mesh
    prepared: Mesh
    opened: Callable[[], Mesh]
    smoothed: bool
    boundary_ratio: float
    eigenvalues: Floats

    @cached_property
    def seen(self) -> tuple[NormalisedSurface, Ints]:
        """The surface as it is, in the frames of its views; noise turns normals, so it is smoothed first."""
        mesh = self.opened() if self.smoothed else self.cleaned
        return view_surface(mesh.vertices, mesh.faces)


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
        Returns the array of a surface, or None if it cannot be computed under the parameters.
    distance : callable
        Returns the distances between the array of one surface and those of c others, shape (c,), >= 0.
    typical : float
        The typical distance of shapes that are near by eigenvalues or views; it stands for unknown distances.
    optional : bool
        Whether embeddings may lack the descriptor.
    available : callable, optional
        Returns whether this installation computes the descriptor, if not every one does.
    """

    shapes: tuple[tuple[int, ...], ...]
    dtype: type[np.generic]
    compute: Callable[[DescribedSurface], NDArray[Any] | None]
    distance: Callable[[NDArray[Any], Sequence[NDArray[Any]]], Floats]
    typical: float
    optional: bool = False
    available: Callable[[], bool] | None = None


def _spin_images(surface: DescribedSurface) -> Bytes:
    """Return spin images; incomplete surfaces are described without filling their holes."""
    is_incomplete = surface.boundary_ratio > INCOMPLETE
    mesh = surface.opened() if is_incomplete else surface.prepared
    return describe(mesh, boundary_ratio=surface.boundary_ratio)


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
        compute=lambda surface: describe_views(*surface.seen),
        distance=lambda query, others: view_distance(
            query, np.array(others, np.uint8).reshape(-1, VIEW_BYTES)
        ),
        typical=0.76,
    ),
    "eigenvalues": Descriptor(
        shapes=((SPECTRUM,),),
        dtype=np.float16,
        compute=lambda surface: log_eigenvalues(surface.eigenvalues),
        distance=eigenvalue_distance,
        typical=0.1,
        optional=True,
    ),
    "network_views": Descriptor(
        shapes=((VIEWS, FEATURES),),
        dtype=np.int8,
        compute=lambda surface: network_views(*surface.seen),
        distance=network_view_distance,
        typical=0.4,
        optional=True,
        available=is_available,
    ),
}
"""The descriptors by name. An embedding changes with this table: raise `core.parameters.METHOD_VERSION`."""

EVERYWHERE = tuple(name for name, row in DESCRIPTORS.items() if row.available is None)
"""The names of the descriptors that every installation computes."""


@dataclass(frozen=True, eq=False)
class ShapeDescriptors:
    """The parts of an embedding that are compared beside its spectra.

    Attributes
    ----------
    signature : float32, shape (s,)
    arrays : dict
        An array for each of `DESCRIPTORS`, by name; optional ones may lack.
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


def computed_descriptors() -> tuple[str, ...]:
    """Return the names of the descriptors that this installation computes."""
    return tuple(name for name, row in DESCRIPTORS.items() if row.available is None or row.available())


def descriptors_of(embedding: Embedding) -> ShapeDescriptors:
    """Return the descriptors of an embedding."""
    reliability = intrinsic_reliability(embedding.facts)
    return ShapeDescriptors(embedding.signature, embedding.descriptors, reliability)


def descriptor_distances(
    query: ShapeDescriptors, others: Sequence[ShapeDescriptors], skipped: Collection[str] = ()
) -> dict[str, Floats]:
    """Return the distances of each descriptor between one shape and c others, shape (c,), by name.

    They are NaN where one of two shapes lacks the descriptor, and typical for the `skipped` descriptors.
    """
    return {
        name: np.full(len(others), descriptor.typical) if name in skipped else _distances(name, query, others)
        for name, descriptor in DESCRIPTORS.items()
    }


def _distances(name: str, query: ShapeDescriptors, others: Sequence[ShapeDescriptors]) -> Floats:
    distances = np.full(len(others), np.nan)
    known = np.array([name in query.arrays and name in other.arrays for other in others], dtype=bool)
    if known.any():
        arrays = [other.arrays[name] for other, is_known in zip(others, known, strict=True) if is_known]
        distances[known] = DESCRIPTORS[name].distance(query.arrays[name], arrays)
    return distances
