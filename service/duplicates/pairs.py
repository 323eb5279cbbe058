"""Candidate pairs of near-identical shapes, by signatures in memory and facts in the database."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.ranking.shortlist import least, signature_distances
from service.duplicates.repository import facts
from service.pipelines.active import ActivePipeline
from service.shapes.records import ShapeFilter
from service.storage.database import ReadSession

NEAREST = 32
"""The number of nearest signatures that each shape is compared with. A larger set of copies is joined through
several links."""


@dataclass(frozen=True, eq=False)
class ExaminedShapes:
    """The shapes to examine.

    Attributes
    ----------
    shapes, embeddings : int64, shape (n,)
        Their numbers, ascending by shape.
    signatures : float32, shape (n, s)
    radii : float64, shape (n,)
        Root mean square distance of the surface from its centroid, divided by the square root of its area;
        invariant under motion, scaling and remeshing.
    """

    shapes: NDArray[np.int64]
    embeddings: NDArray[np.int64]
    signatures: NDArray[np.float32]
    radii: NDArray[np.float64]


def stock(session: ReadSession, active_pipeline: ActivePipeline, wanted: ShapeFilter) -> ExaminedShapes:
    """The shapes that match a filter and have an embedding by the active pipeline."""
    entries = active_pipeline.index.current(session)
    measured = facts(session, wanted)
    radii = {number: each["scale"] / each["area"] ** 0.5 for number, each in measured.items()}
    order = np.argsort(entries.shapes)
    order = order[np.isin(entries.shapes[order], np.fromiter(radii, np.int64, len(radii)))]
    return ExaminedShapes(
        shapes=entries.shapes[order],
        embeddings=entries.embeddings[order],
        signatures=entries.signatures[order],
        radii=np.array([radii[number] for number in entries.shapes[order].tolist()], dtype=np.float64),
    )


def near(stock: ExaminedShapes, place: int, radii: float) -> NDArray[np.intp]:
    """Indices of later shapes whose radius differs by at most `radii`, nearest signatures first.

    The root mean square distances from the centroid of two surfaces differ by at most the distance of the
    surfaces.
    """
    places = np.arange(place + 1, len(stock.shapes))
    places = places[np.abs(stock.radii[places] - stock.radii[place]) <= radii]
    distances = signature_distances(stock.signatures[place], stock.signatures[places])
    return np.asarray(places[least(distances, stock.shapes[places], NEAREST)])
