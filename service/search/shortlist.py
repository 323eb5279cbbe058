"""The candidates of a query: all shapes that match its filter, or a shortlist of them."""

import math
from dataclasses import replace

import numpy as np

from core.arrays import Floats
from core.descriptors.partial import is_part
from core.ranking.class_probability import pooled_log_odds
from core.ranking.differences import CoarseDescriptors, coarse_differences
from core.ranking.shortlist import least
from service.container import Container
from service.index.repository import IndexEntries
from service.search.caches import collection_sample
from service.search.records import Candidates, Query
from service.search.schemas import SearchOptions
from service.search.signature_index import signature_index
from service.shapes import repository as shapes_repository
from service.shapes.records import ShapeFilter

VIEW_SHARE = 0.5
"""Shapes near by view signatures in a shortlist, for each one near by signatures."""


PARTIAL_FACTOR = 2.5
"""Factor of the number of candidates from which a partial query compares a shortlist: this may miss the whole
of a part, whose signature is another."""


def find_candidates(
    container: Container, query: Query, shapes: ShapeFilter, options: SearchOptions
) -> Candidates:
    """Return the shapes that match a filter, without the query itself, or a shortlist of them.

    Stages: read the collection's sample for local densities; select by the filter; unless the search is
    exhaustive or few shapes are left, keep the nearest by signatures and by view signatures. If log odds rank
    the answer, more of both are looked for, and those of greatest approximate log odds stay.
    """
    shortlist_from = container.settings.shortlist_from
    if options.partial:
        shortlist_from = math.ceil(PARTIAL_FACTOR * shortlist_from)
    index = signature_index(container, query.active_pipeline)
    length = container.settings.shortlist_length
    with container.database.read() as session:
        stored = shapes_repository.stored(session, shapes.collection)
        sample = collection_sample(session, container, query.active_pipeline, shapes.collection)
        selection = index.select(session, shapes, query.excluded, stored)
        shortlisted = not options.exhaustive and selection.has(shortlist_from)
        if not shortlisted:
            entries = selection.entries()
        elif options.rank_by == "combined":
            entries = selection.nearest(query, index.widening * length, index.widening * length)
            entries = entries.only(least(-coarse_log_odds(query, entries), entries.shapes, length))
        else:
            entries = selection.nearest(query, length, math.ceil(VIEW_SHARE * length))
    if shortlisted:
        container.metrics.queries_shortlisted.inc()
    # The index of an empty archive has signatures of length 0.
    signatures = entries.signatures.reshape(len(entries.shapes), len(query.embedding.signature))
    entries = replace(entries, signatures=signatures)
    return Candidates(entries, shortlisted, stored, sample, sample.of_query(query.descriptors))


def coarse_log_odds(query: Query, entries: IndexEntries, cc: Floats | None = None) -> Floats:
    """Compute approximate log odds that a query and c shapes are of one class, from the index alone.

    `cc` has the approximate CC of the shapes, shape (c,), as the result; CC typical of the spectral distances
    is taken unless it is given.
    """
    descriptors = query.descriptors
    reliability = np.array([descriptors.reliability], dtype=np.float32)
    return pooled_log_odds(
        coarse_differences(
            CoarseDescriptors(descriptors.signature[None], query.view_signature[None], reliability),
            CoarseDescriptors(entries.signatures, entries.view_signatures, entries.reliabilities),
            cc,
            part=is_part(query.spin_images),
        )
    )
