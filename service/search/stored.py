"""Which signatures a query looks at, found by the database: none of them is kept in memory."""

import numpy as np
from numpy.typing import NDArray

from core.signatures import least, signature_distances
from service.search.records import Options, Query
from service.search.repository import Signed, stacked
from service.shapes.records import ShapeFilter
from service.storage.database import ReadSession
from service.vectors import repository

CLOSE = 16
"""So many more are put in order here: the database's distances are of single precision."""


def signed_in_database(
    session: ReadSession,
    query: Query,
    signature: NDArray[np.float32],
    shapes: ShapeFilter,
    options: Options,
    *,
    ef_search: int,
) -> tuple[Signed, bool]:
    """The shapes to look at, the nearest first where they are a shortlist; and whether they are.

    Without a filter the shortlist is found by the graph, with one by looking at all that it means. Sketches
    are read for a shortlist alone.

    Parameters
    ----------
    session : ReadSession
        Of a PostgreSQL database.
    query : Query
    signature : float32, shape (s,)
        The query's.
    shapes : ShapeFilter
        Which are meant.
    options : Options
    ef_search : int
        As `service.vectors.repository.nearest` takes it.
    """
    fingerprint = query.in_use.fingerprint
    itself = np.array(sorted(query.itself) if options.exclude_self else [], dtype=np.int64)
    if options.exhaustive or not repository.is_many(
        session, fingerprint, shapes, itself.tolist(), options.shortlist_from
    ):
        numbers, embeddings, signatures = repository.signatures(session, fingerprint, shapes)
        others = ~np.isin(numbers, itself)
        none = np.empty((int(others.sum()), 0), np.uint8)
        return Signed(numbers[others], embeddings[others], signatures[others], none), False
    found = repository.nearest(
        session,
        fingerprint,
        signature,
        options.shortlist_length + len(itself) + CLOSE,
        shapes=shapes,
        ef_search=ef_search if shapes.is_empty else None,
    )
    others = ~np.isin(found.shapes, itself)
    numbers, embeddings = found.shapes[others], found.embeddings[others]
    known = repository.signed(session, embeddings)
    signatures = stacked([known[number][0] for number in embeddings.tolist()]).view("<f4")
    nearest = least(signature_distances(signature, signatures), numbers, options.shortlist_length)
    sketches = stacked([known[number][1] for number in embeddings[nearest].tolist()])
    return Signed(numbers[nearest], embeddings[nearest], signatures[nearest], sketches), True
