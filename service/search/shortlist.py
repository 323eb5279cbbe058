"""Which of the stored shapes a query is compared with."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.ranking.shortlist import least, signature_distances
from core.serialization import embedding_from_bytes
from service.container import Parts
from service.index.repository import Signed
from service.observability.logging import get_logger
from service.search.database_shortlist import signed_in_database
from service.search.records import Options, Query
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter
from service.storage.database import ReadSession

log = get_logger("search")

FEW = 3
"""Of so many shapes one that is meant is few."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """The shapes to compare.

    Attributes
    ----------
    shapes, embeddings : int64, shape (c,)
        The numbers of the shapes, and of their embeddings.
    signature : float32, shape (s,)
        The query's.
    signatures : float32, shape (c, s)
    sketches : uint8, shape (c, l)
    screened, finalists : int or None
        How many of them are looked at more closely after a rough look at each, and how many of those are
        compared in full; None is all.
    stored : int
        How many shapes the collection has.
    """

    shapes: NDArray[np.int64]
    embeddings: NDArray[np.int64]
    signature: NDArray[np.float32]
    signatures: NDArray[np.float32]
    sketches: NDArray[np.uint8]
    screened: int | None
    finalists: int | None
    stored: int

    def only(self, places: NDArray[np.intp]) -> "Candidates":
        """Those at some places."""
        return replace(
            self,
            shapes=self.shapes[places],
            embeddings=self.embeddings[places],
            signatures=self.signatures[places],
            sketches=self.sketches[places],
        )


def candidates(parts: Parts, query: Query, options: Options) -> Candidates:
    """Those that the filter means, less the query itself, less those that are far by signature."""
    embedding = embedding_from_bytes(query.record)
    wanted = options.filter
    if options.sizes is not None:
        area, most = embedding.facts.area, options.sizes**2
        wanted = replace(wanted, area=(area / most, area * most))
    with parts.database.read() as session:
        stored = shapes_repository.stored(session, wanted.collection)
        if parts.settings.signatures == "database":
            ef_search = parts.settings.hnsw_ef_search
            signed, shortlisted = signed_in_database(
                session, query, embedding.signature, wanted, options, stored, ef_search=ef_search
            )
        else:
            signed, shortlisted = _in_memory(session, query, embedding.signature, wanted, options, stored)
    if shortlisted:
        parts.metrics.queries_shortlisted.inc()
    finalists = options.finalists + options.top_k
    return Candidates(
        shapes=signed.shapes,
        embeddings=signed.embeddings,
        signature=embedding.signature,
        # Where nothing is stored yet, no length is known.
        signatures=signed.signatures.reshape(len(signed.shapes), len(embedding.signature)),
        sketches=signed.sketches,
        screened=max(options.screened, finalists) if shortlisted else None,
        finalists=finalists if shortlisted else None,
        stored=stored,
    )


def _in_memory(
    session: ReadSession,
    query: Query,
    signature: NDArray[np.float32],
    wanted: ShapeFilter,
    options: Options,
    stored: int,
) -> tuple[Signed, bool]:
    """The shapes to look at, and whether they are a shortlist, by the signatures in memory."""
    signed = query.in_use.index.current(session)
    chosen = signed.collections == wanted.collection
    lacking = stored - np.count_nonzero(chosen)
    if lacking > 0:
        log.info(
            "%d of %d stored shapes have no embedding of the pipeline in use and are not searched",
            lacking,
            stored,
        )
    if not wanted.is_empty:
        meant = shapes_repository.numbers(session, wanted)
        chosen &= np.isin(signed.shapes, np.array(meant, dtype=np.int64))
    if options.exclude_self:
        for number in query.itself:
            chosen &= signed.shapes != number
    places = np.flatnonzero(chosen)
    shortlisted = not options.exhaustive and len(places) >= options.shortlist_from
    if shortlisted:
        # Where nearly all are meant, picking them out takes longer than looking at the others too.
        if FEW * len(places) < len(signed.shapes):
            distances = signature_distances(signature, signed.signatures[places])
        else:
            distances = signature_distances(signature, signed.signatures)[places]
        places = places[least(distances, signed.shapes[places], options.shortlist_length)]
    if not shortlisted:
        signed = replace(signed, sketches=np.empty((len(signed.shapes), 0), np.uint8))
    return signed.only(places), shortlisted
