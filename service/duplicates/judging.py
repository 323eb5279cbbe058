"""The judgement of one shape: its copies and variants among the judged shapes of its collection."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from core.errors import BadRecordError, MeshError
from core.registration.invariants import possible_copies, possible_variants
from core.registration.rigid_copy import RigidCopy
from service.collection import CollectionNumber
from service.container import Container
from service.duplicates import repository
from service.duplicates.groups import Groups, Link
from service.duplicates.judgements import Judgement, Search
from service.duplicates.registering import Side, registered, side_of
from service.errors import FileTimeLimitError, ShapeNotFoundError, WorkerCrashedError
from service.index.surface_measurements import MeasuredShapes
from service.observability.logging import get_logger
from service.pipelines.active import ActivePipeline
from service.search import repository as search_repository
from service.search.likeness import once
from service.search.records import Query
from service.search.scoring import compare_with
from service.search.shortlist import Candidates
from service.storage.database import ReadSession

log = get_logger("duplicates")

NEAREST, NEAREST_VARIANTS = 256, 16
"""Each shape is compared with at most so many possible copies, and possible variants, of least spectral
distance. Copies beyond them join its group through others."""

REGISTERED = 32
"""Largest number of pairs that are registered for one shape."""


@dataclass(frozen=True, eq=False)
class _View:
    """A shape as the database has it.

    Attributes
    ----------
    measured : MeasuredShapes
        All shapes.
    place : int
        The index of the shape.
    record : bytes
        Its embedding record; empty if that is damaged.
    candidates : int, shape (k,)
        Indices of its judged candidates, the nearest first.
    links : sequence of Link
        The pairs of copies among them.
    latest : int
        The number of the latest judgement.
    """

    measured: MeasuredShapes
    place: int
    record: bytes
    candidates: NDArray[np.intp]
    links: Sequence[Link]
    latest: int


@dataclass(eq=False)
class ShapeJudge:
    """Judges one shape. Other shapes may be judged at the same time, also by other services.

    Parameters
    ----------
    container : Container
    active_pipeline : ActivePipeline
    search : Search
    collection : CollectionNumber
    shape : int
        The number of the shape.
    """

    container: Container
    active_pipeline: ActivePipeline
    search: Search
    collection: CollectionNumber
    shape: int
    _links: list[Link] = field(default_factory=list, init=False)
    _considered: set[int] = field(default_factory=set, init=False)
    _compared: int = field(default=0, init=False)
    _aligned: int = field(default=0, init=False)
    _own: Side | None = field(default=None, init=False)

    async def judge(self) -> None:
        """Compare the shape with its candidates and store the judgement.

        Nothing is done if the shape is deleted, or judged meanwhile.
        """
        while (view := await run_in_threadpool(self._look)) is not None:
            await self._compare(view)
            if await run_in_threadpool(self._store, view):
                return

    def _look(self) -> _View | None:
        with self.container.database.read() as session:
            measured = self._measured(session)
            place = measured.place_of(self.shape)
            if place is None:
                return None
            embedding = int(measured.embeddings[place])
            record = search_repository.embedding_records(session, [embedding]).get(embedding)
            near = self._near(measured, place)
            done = repository.judged(session, self.search, [self.shape, *measured.shapes[near].tolist()])
            if self.shape in done:
                return None
            near = near[np.isin(measured.shapes[near], list(done))]
            numbers = [self.shape, *measured.shapes[near].tolist()]
            links = repository.links_among(session, self.search.fingerprint, numbers)
            return _View(measured, place, record or b"", near, links, repository.latest(session))

    def _measured(self, session: ReadSession) -> MeasuredShapes:
        ranking = self.active_pipeline.pipeline.parameters.ranking
        return self.container.measurements.current(
            session, self.active_pipeline.index, global_descriptors=ranking.global_descriptors
        )

    def _near(self, measured: MeasuredShapes, place: int) -> NDArray[np.intp]:
        """Candidates of the same collection, the least spectral distance first."""
        invariants = measured.invariants
        if self.search.variants:
            near, most = possible_variants(invariants, place), NEAREST_VARIANTS
        else:
            near, most = possible_copies(invariants, place, self.search.max_residual), NEAREST
        near = near[measured.collections[near] == self.collection]
        order = np.argsort(invariants.spectral_distances(place, near), kind="stable")
        return np.asarray(near[order[:most]])

    async def _compare(self, view: _View) -> None:
        """Register the candidates with the wanted CC, unless other pairs have joined them to the shape."""
        groups = Groups()
        for link in (*view.links, *self._links):
            groups.join(link)
        new = [place for place in view.candidates if int(view.measured.shapes[place]) not in self._considered]
        for start in range(0, len(new) if view.record else 0, REGISTERED):
            shapes = view.measured.shapes
            some = [
                place
                for place in new[start : start + REGISTERED]
                if not groups.joined(self.shape, int(shapes[place]))
            ]
            self._compared += len(some)
            for number, cc in await self._scored(view, np.array(some, dtype=np.intp)):
                if self._aligned < REGISTERED and not groups.joined(self.shape, number):
                    await self._register(view, groups, number, cc)
        self._considered |= {int(view.measured.shapes[place]) for place in new}

    async def _scored(self, view: _View, places: NDArray[np.intp]) -> list[tuple[int, float]]:
        """The candidates at some indices with the wanted CC, in their order."""
        if not len(places):
            return []
        measured = view.measured
        candidates = Candidates(
            shapes=measured.shapes[places],
            embeddings=measured.embeddings[places],
            signature=measured.signatures[view.place],
            signatures=measured.signatures[places],
            coarse_samples=np.empty((len(places), 0), np.uint8),
            view_signatures=np.empty((len(places), 0), np.uint8),
            reliabilities=np.full(len(places), np.nan, np.float32),
            reranked=None,
            finalists=None,
            stored=len(measured.shapes),
            sample=None,
            density=None,
        )
        query = Query(self.active_pipeline, view.record, frozenset([self.shape]))
        found, _ = await compare_with(self.container, query, candidates, "cc")
        scores = zip(found.shapes.tolist(), found.cc.tolist(), strict=True)
        return [(number, cc) for number, cc in scores if cc >= self.search.min_cc]

    async def _register(self, view: _View, groups: Groups, number: int, cc: float) -> None:
        """Register a pair, the older shape first, and keep it if it is a copy or a variant."""
        first, second = sorted((self.shape, number))
        self._aligned += 1
        try:
            sides = await self._side(view, first), await self._side(view, second)
            parameters = self.active_pipeline.pipeline.parameters
            copy = await registered(self.container, *sides, parameters, variants=self.search.variants)
        except (
            BadRecordError,
            FileTimeLimitError,
            MeshError,
            ShapeNotFoundError,
            WorkerCrashedError,
        ) as error:
            log.warning("two shapes cannot be aligned: %s", error)
            return
        if copy is not None and copy.residual <= self.search.max_residual:
            link = _link(first, second, cc, copy)
            groups.join(link)
            self._links.append(link)

    async def _side(self, view: _View, number: int) -> Side:
        if number == self.shape and self._own is not None:
            return self._own
        place = view.measured.place_of(number)
        assert place is not None
        embedding = int(view.measured.embeddings[place])
        side = await side_of(self.container, self.collection, number, embedding)
        if number == self.shape:
            self._own = side = Side(side.record, once(side.mesh))
        return side

    def _store(self, view: _View) -> bool:
        """Store the judgement; False if a candidate was judged meanwhile and has not been compared."""
        search, shapes = self.search, view.measured.shapes
        with self.container.database.write() as session:
            if not repository.exists(session, self.shape, int(view.measured.embeddings[view.place])):
                return True
            newer = repository.judged_since(session, search, view.latest) - {self.shape}
            near = set(shapes[self._near(view.measured, view.place)].tolist())
            if any(view.measured.place_of(each) is None for each in newer) or newer & near:
                # A shape that was judged again may have another file.
                self._considered -= newer
                self._links = [link for link in self._links if not {link.first, link.second} & newer]
                return False
            ends = {link.first for link in self._links} | {link.second for link in self._links}
            there = repository.judged(session, search, sorted(ends)) | {self.shape}
            links = [link for link in self._links if {link.first, link.second} <= there]
            repository.write(session, search, Judgement(self.shape, links, self._compared, self._aligned))
            return True


def _link(first: int, second: int, cc: float, copy: RigidCopy) -> Link:
    variant = copy.difference is not None
    return Link(first, second, cc, copy.residual, copy.scale, mirrored=copy.mirrored, variant=variant)
