"""The judgement of one shape: its copies and variants among the judged shapes of its collection.

Two shapes are registered by their records, or by their files where the records do not suffice.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray

from core.errors import BadRecordError, MeshError
from core.registration.invariants import possible_copies, possible_variants
from service.collection import CollectionNumber
from service.container import Container
from service.duplicates import repository
from service.duplicates.groups import Groups, Link, Search
from service.errors import FileTimeLimitError, ShapeNotFoundError, WorkerCrashedError
from service.index.repository import has_embedding
from service.index.signature_table import MeasuredShapes
from service.observability.logging import get_logger
from service.pipelines.active import ActivePipeline
from service.search import repository as search_repository
from service.search.caches import CandidateReader
from service.search.likeness import find_copy, stored_surface
from service.search.records import Candidates, Query, Surface
from service.search.scoring import Cascade
from service.shapes import repository as shapes_repository
from service.storage.database import ReadSession, WriteSession

log = get_logger("duplicates")

NEAREST, NEAREST_VARIANTS = 256, 16
"""Each shape is compared with at most so many possible copies, and possible variants, of least spectral
distance. Copies beyond them join its group through others."""

REGISTERED = 32
"""Largest number of pairs that are registered for one shape."""


@dataclass(frozen=True, eq=False)
class _Snapshot:
    """The database as one transaction reads it for the judgement of a shape.

    The shape has an `index` among all `measured` shapes, and an embedding `record`, empty if that is damaged.
    `candidates` has the indices of its judged candidates, the nearest first, and `links` the pairs of copies
    among them. `latest` is the number of the latest judgement.
    """

    measured: MeasuredShapes
    index: int
    record: bytes
    candidates: NDArray[np.intp]
    links: Sequence[Link]
    latest: int


@dataclass(eq=False)
class ShapeJudge:
    """Judges one shape, by number. Other shapes may be judged at the same time, also by other services."""

    container: Container
    active_pipeline: ActivePipeline
    search: Search
    collection: CollectionNumber
    shape: int
    _links: list[Link] = field(default_factory=list, init=False)
    _considered: set[int] = field(default_factory=set, init=False)
    _compared: int = field(default=0, init=False)
    _aligned: int = field(default=0, init=False)
    _surface: Surface | None = field(default=None, init=False)

    async def judge(self) -> None:
        """Compare the shape with its candidates and store the judgement.

        Nothing is done if the shape is deleted, or judged meanwhile.
        """
        database = self.container.database
        while (snapshot := await database.reading(self._look)) is not None:
            await self._compare(snapshot)
            if await database.writing(self._store, snapshot):
                return

    def _look(self, session: ReadSession) -> _Snapshot | None:
        if repository.judged(session, self.search, [self.shape]):
            return None
        measured = self.container.measurements.current(session, self.active_pipeline.index)
        index = measured.index_of(self.shape)
        if index is None:
            return None
        embedding = int(measured.entries.embeddings[index])
        record = search_repository.embedding_records(session, [embedding]).get(embedding)
        near = self._near(measured, index)
        done = repository.judged(session, self.search, measured.entries.shapes[near].tolist())
        near = near[np.isin(measured.entries.shapes[near], list(done))]
        numbers = [self.shape, *measured.entries.shapes[near].tolist()]
        links = repository.links_among(session, self.search.fingerprint, numbers)
        return _Snapshot(measured, index, record or b"", near, links, repository.latest(session))

    def _near(self, measured: MeasuredShapes, index: int) -> NDArray[np.intp]:
        """Return candidates of the same collection, the least spectral distance first."""
        invariants = measured.invariants
        groups = [(possible_copies(invariants, index), NEAREST)]
        if self.search.variants:
            groups.append((possible_variants(invariants, index), NEAREST_VARIANTS))
        nearest: list[int] = []
        for near, most in groups:
            of_collection = near[measured.entries.collections[near] == self.collection]
            order = np.argsort(invariants.spectral_distances(index, of_collection), kind="stable")
            nearest += of_collection[order[:most]].tolist()
        return np.array(list(dict.fromkeys(nearest)), dtype=np.intp)

    async def _compare(self, snapshot: _Snapshot) -> None:
        """Register the candidates, unless other pairs have joined them to the shape.

        A shape that is no copy of a mesh, within its chord errors, is mostly no copy of a finer mesh of that
        surface: a candidate is left out if one of its copies with no more faces was refused.
        """
        groups = Groups()
        for link in (*snapshot.links, *self._links):
            groups.join(link)
        shapes = snapshot.measured.entries.shapes
        new = [index for index in snapshot.candidates if int(shapes[index]) not in self._considered]
        faces = {int(shapes[index]): snapshot.measured.invariants.faces[index] for index in new}
        refused: list[int] = []
        for start in range(0, len(new) if snapshot.record else 0, REGISTERED):
            batch = [
                index
                for index in new[start : start + REGISTERED]
                if not groups.joined(self.shape, int(shapes[index]))
            ]
            self._compared += len(batch)
            for number, cc in await self._scored(snapshot, np.array(batch, dtype=np.intp)):
                decided = groups.joined(self.shape, number) or any(
                    faces[other] <= faces[number] and groups.joined(other, number) for other in refused
                )
                if self._aligned < REGISTERED and not decided:
                    await self._register(snapshot, groups, refused, number, cc)
        self._considered |= {int(shapes[index]) for index in new}

    async def _scored(self, snapshot: _Snapshot, indices: NDArray[np.intp]) -> list[tuple[int, float]]:
        """Return the candidates at some indices, in their order, each with its CC."""
        if not len(indices):
            return []
        measured = snapshot.measured.entries
        candidates = Candidates(measured.only(indices), shortlisted=False, stored=len(measured.shapes))
        query = Query(snapshot.record, active_pipeline=self.active_pipeline, excluded=frozenset([self.shape]))
        reader = CandidateReader(self.container, self.active_pipeline)
        matched = await Cascade(self.container, query, reader).score(candidates, len(indices))
        return list(zip(matched.candidates.entries.shapes.tolist(), matched.cc.tolist(), strict=True))

    async def _register(
        self, snapshot: _Snapshot, groups: Groups, refused: list[int], number: int, cc: float
    ) -> None:
        """Register a pair, the older shape first, and keep it if it is a copy or a variant.

        The candidate joins the `refused` ones if it is neither and only copies are sought.
        """
        first, second = sorted((self.shape, number))
        self._aligned += 1
        try:
            surfaces = await self._stored(snapshot, first), await self._stored(snapshot, second)
            parameters = self.active_pipeline.pipeline.parameters
            copy = await find_copy(self.container, *surfaces, parameters, variants=self.search.variants)
        except (
            BadRecordError,
            FileTimeLimitError,
            MeshError,
            ShapeNotFoundError,
            WorkerCrashedError,
        ) as error:
            log.warning("two shapes cannot be aligned: %s", error)
            return
        if copy is None and not self.search.variants:
            refused.append(number)
        if copy is not None and copy.residual <= self.search.max_residual:
            link = Link(
                first,
                second,
                cc,
                copy.residual,
                copy.scale,
                copy.mirrored,
                variant=copy.difference is not None,
                difference=None if copy.difference is None else asdict(copy.difference),
            )
            groups.join(link)
            self._links.append(link)

    async def _stored(self, snapshot: _Snapshot, number: int) -> Surface:
        """Return a stored surface to register.

        Raises
        ------
        ShapeNotFoundError
            The shape or its embedding was deleted.
        """
        if number == self.shape and self._surface is not None:
            return self._surface
        index = snapshot.measured.index_of(number)
        assert index is not None
        embedding = int(snapshot.measured.entries.embeddings[index])

        def read(session: ReadSession) -> Surface:
            records = search_repository.embedding_records(session, [embedding])
            shapes = shapes_repository.records(session, self.collection, [number])
            if not (records and shapes):
                raise ShapeNotFoundError(str(number))
            return stored_surface(self.container, self.collection, shapes[0].id, records[embedding])

        surface = await self.container.database.reading(read)
        if number == self.shape:
            self._surface = surface
        return surface

    def _store(self, session: WriteSession, snapshot: _Snapshot) -> bool:
        """Store the judgement; False if a candidate was judged meanwhile and has not been compared."""
        search, shapes = self.search, snapshot.measured.entries.shapes
        embedding = int(snapshot.measured.entries.embeddings[snapshot.index])
        if not has_embedding(session, self.shape, embedding):
            return True
        newer = repository.judged_since(session, search, snapshot.latest) - {self.shape}
        near = set(shapes[self._near(snapshot.measured, snapshot.index)].tolist())
        if any(snapshot.measured.index_of(each) is None for each in newer) or newer & near:
            # A shape that was judged again may have another file.
            self._considered -= newer
            self._links = [link for link in self._links if not {link.first, link.second} & newer]
            return False
        ends = {link.first for link in self._links} | {link.second for link in self._links}
        present = repository.judged(session, search, sorted(ends)) | {self.shape}
        links = [link for link in self._links if {link.first, link.second} <= present]
        repository.write(session, search, self.shape, links, compared=self._compared, aligned=self._aligned)
        return True
