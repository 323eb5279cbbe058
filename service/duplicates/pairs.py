"""Which stored shapes may be copies of one another, by what is in memory and in their records."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.ranking.shortlist import least, signature_distances
from service.duplicates.repository import facts
from service.pipelines.active import ActivePipeline
from service.shapes.records import ShapeFilter
from service.storage.database import ReadSession

NEAREST = 32
"""How many of the shapes nearest by signature each is compared with. More copies than this of one shape are
joined through one another."""


@dataclass(frozen=True, eq=False)
class Stock:
    """The shapes that are looked at, by number.

    Attributes
    ----------
    shapes, embeddings : int64, shape (n,)
    signatures : float32, shape (n, s)
    radii : float64, shape (n,)
        Root mean square distance of the surface from its centroid over the root of its area, which no
        motion, scaling or meshing changes.
    """

    shapes: NDArray[np.int64]
    embeddings: NDArray[np.int64]
    signatures: NDArray[np.float32]
    radii: NDArray[np.float64]


def stock(session: ReadSession, active_pipeline: ActivePipeline, wanted: ShapeFilter) -> Stock:
    """The shapes that a filter means, as far as the pipeline in use embedded them."""
    entries = active_pipeline.index.current(session)
    measured = facts(session, wanted)
    radii = {number: each["scale"] / each["area"] ** 0.5 for number, each in measured.items()}
    order = np.argsort(entries.shapes)
    order = order[np.isin(entries.shapes[order], np.fromiter(radii, np.int64, len(radii)))]
    return Stock(
        shapes=entries.shapes[order],
        embeddings=entries.embeddings[order],
        signatures=entries.signatures[order],
        radii=np.array([radii[number] for number in entries.shapes[order].tolist()], dtype=np.float64),
    )


def near(stock: Stock, place: int, residual: float) -> NDArray[np.intp]:
    """The places behind one whose shapes may lie within a residual of it, the nearest by signature.

    Distances from the centroid differ, in the root mean square, by no more than the surfaces lie apart.
    """
    places = np.arange(place + 1, len(stock.shapes))
    places = places[np.abs(stock.radii[places] - stock.radii[place]) <= residual]
    distances = signature_distances(stock.signatures[place], stock.signatures[places])
    return np.asarray(places[least(distances, stock.shapes[places], NEAREST)])
