"""A query, its candidates, their scores, and its results."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes
from core.descriptors.registry import ShapeDescriptors, descriptors_of
from core.descriptors.views import view_signature
from core.embedding import Embedding
from core.mesh.mesh import Mesh
from core.ranking.likeness import Likeness
from core.ranking.local_density import LocalDensities
from core.registration.rigid_copy import Difference
from core.serialization import embedding_from_bytes
from service.index.density_samples import CollectionSample
from service.index.repository import IndexEntries
from service.pipelines.active import ActivePipeline
from service.shapes.records import ShapeRecord

ReadMesh = Callable[[], Awaitable[Mesh]]


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface to compare.

    Attributes
    ----------
    record : bytes
        Its embedding as it is stored, and sent to workers.
    mesh : callable or None
        Reads its mesh; None for a surface whose likeness to others is not asked for.
    """

    record: bytes
    mesh: ReadMesh | None = None

    @cached_property
    def embedding(self) -> Embedding:
        """The record, decoded once."""
        return embedding_from_bytes(self.record)

    @property
    def radius(self) -> float:
        """Root mean square distance of the surface from its centroid over the root of its area."""
        return float(self.embedding.facts.scale / self.embedding.facts.area**0.5)


def once(read: ReadMesh) -> ReadMesh:
    """Return a function that reads a mesh at its first call and keeps it."""
    meshes: list[Mesh] = []

    async def kept() -> Mesh:
        if not meshes:
            meshes.append(await read())
        return meshes[0]

    return kept


@dataclass(frozen=True, eq=False, kw_only=True)
class Query(Surface):
    """The surface that is searched for.

    Attributes
    ----------
    active_pipeline : ActivePipeline
        The pipeline that embedded it.
    excluded : frozenset of int
        The numbers of stored shapes that are left out: the query itself.
    number : int or None
        The number of the embedding, if it is stored.
    """

    active_pipeline: ActivePipeline
    excluded: frozenset[int]
    number: int | None = None

    @cached_property
    def descriptors(self) -> ShapeDescriptors:
        """The descriptors of its surface."""
        return descriptors_of(self.embedding)

    @cached_property
    def view_signature(self) -> Bytes:
        """The view signature, shape (v,)."""
        return view_signature(self.embedding.descriptors["views"])

    @property
    def spin_images(self) -> Bytes:
        """The spin images of its surface."""
        return self.descriptors.arrays["spin_images"]


@dataclass(frozen=True, eq=False)
class Candidates:
    """The shapes that a query is compared with.

    Attributes
    ----------
    entries : IndexEntries
        Their signatures and other short descriptors.
    shortlisted : bool
        Whether they are a shortlist, of which only the best are matched in full.
    stored : int
        Number of shapes in the collection.
    sample : CollectionSample or None
        The sample in which local densities are measured; typical densities are used without one.
    density : LocalDensities or None
        Of the query, in the sample.
    """

    entries: IndexEntries
    shortlisted: bool
    stored: int
    sample: CollectionSample | None = None
    density: LocalDensities | None = None

    def __len__(self) -> int:
        """Return the number of candidates."""
        return len(self.entries.shapes)

    def only(self, indices: NDArray[np.integer] | NDArray[np.bool_]) -> "Candidates":
        """Return the candidates at some indices, or those that a mask selects."""
        return replace(self, entries=self.entries.only(indices))


@dataclass(frozen=True, eq=False)
class MatchedCandidates:
    """Candidates and their scores with the query; each array has shape (c,).

    Attributes
    ----------
    candidates : Candidates
    cc, ssd, sim : float64
        See `core.matching`. Similar shapes have a small `ssd`, and large `cc` and `sim`.
    log_odds : float64 or None
        The log odds that the two shapes are of one class, if the answer is ranked by them.
    """

    candidates: Candidates
    cc: NDArray[np.float64]
    ssd: NDArray[np.float64]
    sim: NDArray[np.float64]
    log_odds: NDArray[np.float64] | None = None

    def only(self, indices: NDArray[np.integer] | NDArray[np.bool_]) -> "MatchedCandidates":
        """Return the candidates at some indices, or those that a mask selects, with their scores."""
        return MatchedCandidates(
            self.candidates.only(indices),
            self.cc[indices],
            self.ssd[indices],
            self.sim[indices],
            None if self.log_odds is None else self.log_odds[indices],
        )


@dataclass(frozen=True)
class Relation:
    """The likeness of a second shape to a first one.

    Attributes
    ----------
    likeness : Likeness
    scale : float or None
        Length in the second shape over length in the first, if the second is a rigid copy or a variant.
    difference : Difference or None
        Where a variant differs.
    """

    likeness: Likeness
    scale: float | None = None
    difference: Difference | None = None


@dataclass(frozen=True, eq=False)
class SearchResult:
    """One shape of an answer, before its likeness is told.

    Attributes
    ----------
    shape : ShapeRecord
    surface : Surface or None
        Its surface, if its record was read: for correspondences, or since the shape may be a rigid copy.
    cc, ssd, sim : float
        Its scores with the query.
    combined : float
        The class probability at the density of the collection's shapes.
    probability : float
        The greater of `combined` and the class probability at the typical density, which does not depend on
        other stored shapes.
    spectral : float
        The distance of its log eigenvalues from those of the query.
    """

    shape: ShapeRecord
    surface: Surface | None
    cc: float
    ssd: float
    sim: float
    combined: float
    probability: float
    spectral: float
