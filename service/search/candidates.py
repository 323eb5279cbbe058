"""Which of the stored shapes a query is compared with."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.records import embedding_from_bytes
from service.logging import get_logger
from service.parts import Parts
from service.search.records import Options, Query
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter

log = get_logger("search")


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
    stored : int
        How many shapes there are in all.
    """

    shapes: NDArray[np.int64]
    embeddings: NDArray[np.int64]
    signature: NDArray[np.float32]
    signatures: NDArray[np.float32]
    stored: int


def candidates(parts: Parts, query: Query, options: Options) -> Candidates:
    """Those that the filter means, less the query itself, less those that are far by signature."""
    embedding = embedding_from_bytes(query.record)
    wanted = options.filter
    if options.sizes is not None:
        area, most = embedding.facts.area, options.sizes**2
        wanted = replace(wanted, area=(area / most, area * most))
    with parts.database.read() as session:
        signed = query.in_use.index.current(session)
        stored = shapes_repository.count(session, ShapeFilter())
        chosen = np.ones(len(signed.shapes), dtype=bool)
        if not wanted.is_empty:
            meant = shapes_repository.numbers(session, wanted)
            chosen &= np.isin(signed.shapes, np.array(meant, dtype=np.int64))
    if stored > len(signed.shapes):
        log.info(
            "%d of %d stored shapes have no embedding of the pipeline in use and are not searched",
            stored - len(signed.shapes),
            stored,
        )
    if options.exclude_self:
        chosen &= ~np.isin(signed.shapes, np.array(sorted(query.itself), dtype=np.int64))
    places = np.flatnonzero(chosen)
    signature = embedding.signature
    if not options.exhaustive and len(places) >= options.shortlist_from:
        distances = query.in_use.pipeline.signature_distances(signature, signed.signatures[places])
        nearest = np.lexsort((signed.shapes[places], distances))[: options.shortlist_length]
        places = places[nearest]
        parts.metrics.queries_shortlisted.inc()
    return Candidates(
        shapes=signed.shapes[places],
        embeddings=signed.embeddings[places],
        signature=signature,
        # Where nothing is stored yet, the index knows of no length.
        signatures=signed.signatures[places].reshape(len(places), len(signature)),
        stored=stored,
    )
