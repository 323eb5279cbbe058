"""A query, its candidates and their scores."""

import asyncio
import hashlib
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes
from core.descriptors.registry import ShapeDescriptors, descriptors_of
from core.descriptors.views import view_signature
from core.embedding import Embedding, Facts
from core.mesh.mesh import Mesh
from core.ranking.local_density import LocalDensities
from core.registration.rigid_copy import Proportions, proportions
from core.serialization import embedding_from_bytes
from service.index.cache import CollectionSample
from service.index.repository import IndexEntries
from service.pipelines.active import ActivePipeline
from service.shapes.schemas import MeasuredMesh

ReadMesh = Callable[[], Awaitable[Mesh]]


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface to compare: the record of its embedding, which workers receive, and a reader of its mesh.

    `mesh` is None for a surface whose likeness to others is not asked for.
    """

    record: bytes
    mesh: ReadMesh | None = None

    @cached_property
    def embedding(self) -> Embedding:
        """The record, decoded once."""
        return embedding_from_bytes(self.record)

    @cached_property
    def digest(self) -> bytes:
        """The SHA-256 of the record, which tells the surface."""
        return hashlib.sha256(self.record).digest()

    @property
    def proportions(self) -> Proportions:
        """The sizes of the surface at unit area."""
        return proportions_of(asdict(self.embedding.facts))


def proportions_of(facts: Mapping[str, Any]) -> Proportions:
    """Return the proportions of a surface with these facts, by name."""
    return proportions(**{name: facts[name] for name in ("area", "volume", "scale", "boundary_edges")})


def may_be_part(first: Facts, second: Mapping[str, Any]) -> bool:
    """Return whether one surface may be a piece of the other, by the facts of both."""
    one, several = sorted(
        ((first.components, first.area), (second["components"], second["area"])), key=itemgetter(0)
    )
    return one[0] == 1 < several[0] and bool(one[1] <= several[1])


def once(read: ReadMesh) -> ReadMesh:
    """Return a function that reads a mesh at its first call and keeps it; other calls wait for that one."""
    meshes: list[Mesh] = []
    reading = asyncio.Lock()

    async def kept() -> Mesh:
        async with reading:
            if not meshes:
                meshes.append(await read())
        return meshes[0]

    return kept


@dataclass(frozen=True, eq=False, kw_only=True)
class Query(Surface):
    """The surface that is searched for, and the pipeline that embedded it.

    `excluded` has the numbers of the stored shapes that are left out: the query itself. `measured` is what
    an answer says of the query, `number` that of the embedding, if it is stored, and `warnings` those of the
    reader of a file.
    """

    active_pipeline: ActivePipeline
    excluded: frozenset[int]
    measured: MeasuredMesh | None = None
    number: int | None = None
    warnings: tuple[str, ...] = ()

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
    """The shapes that a query is compared with: signatures and other short descriptors.

    Of a shortlist (`shortlisted`), only the best are matched in full. `stored` is the number of shapes in the
    collection. Local densities are measured in `sample`, and `density` is that of the query; without a
    sample, typical densities are used.
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
    """Candidates and their scores with the query (`core.embedding.Scores`); each array has shape (c,).

    `log_odds` that the two shapes are of one class are there if they rank the answer, and `contextual` scores
    (`core.ranking.diffusion`) if these do.
    """

    candidates: Candidates
    cc: NDArray[np.float64]
    ssd: NDArray[np.float64]
    sim: NDArray[np.float64]
    log_odds: NDArray[np.float64] | None = None
    contextual: NDArray[np.float64] | None = None

    def only(self, indices: NDArray[np.integer] | NDArray[np.bool_]) -> "MatchedCandidates":
        """Return the candidates at some indices, or those that a mask selects, with their scores."""
        return MatchedCandidates(
            self.candidates.only(indices),
            self.cc[indices],
            self.ssd[indices],
            self.sim[indices],
            None if self.log_odds is None else self.log_odds[indices],
            None if self.contextual is None else self.contextual[indices],
        )
