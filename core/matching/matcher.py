"""The interface of the matchers, and the choice between them."""

from collections.abc import Iterable
from typing import Any, Protocol, TypeVar

from core.arrays import Int8s, Ints
from core.embedding import Embedding, Match, Scores
from core.matching.procrustes import ProcrustesMatcher
from core.matching.tps_matcher import TpsMatcher
from core.parameters import Parameters


class Prepared(Protocol):
    """A shape as its matcher reads it."""

    @property
    def nbytes(self) -> int:
        """Return the memory held, in bytes."""


Shape = TypeVar("Shape", bound=Prepared)


class Matcher(Protocol[Shape]):
    """A method of matching embeddings under one set of parameters.

    A shape is prepared once, its splines factored, and then matched with any number of others. Scores are the
    same whichever of two shapes comes first: the matcher puts a pair in an order of its own (the smaller
    cloud, then the smaller `embedding_key`, of `core.matching.match_records`).
    """

    @property
    def uses_match_records(self) -> bool:
        """Return whether a prepared shape is a match record: see `core.matching.match_records`.

        Match records are small enough to be cached for a whole archive, and are scored without the GIL.
        """

    def prepare(self, embedding: Embedding, key: bytes) -> Shape:
        """Return the embedding, whose `embedding_key` is `key`, with its splines factored."""

    def score(self, query: Shape, candidates: Iterable[Shape]) -> Scores:
        """Return CC, SSD and sim of one shape with each of c others: arrays of shape (c,)."""

    def match(self, first: Shape, second: Shape, orientations: tuple[Int8s, Int8s] | None = None) -> Match:
        """Return the scores of two shapes and their correspondence.

        With the orientations of both embeddings, int8 of shapes (m, p) and (n, p), the correspondence
        preserves orientation if a map that fits about as well as the best one does. Scores do not depend on
        them.
        """

    def candidates(
        self, first: Shape, second: Shape, orientations: tuple[Int8s, Int8s], most: int
    ) -> tuple[list[Ints], list[bool] | None]:
        """Return correspondences that fit about equally well, of each orientation best first.

        Each has pairs of samples, shape (p, 2); a sample may be in several. At most `most` preserve
        orientation. The second list tells which reverse it; it is None if the matcher does not use
        orientations.
        """


def matcher_of(parameters: Parameters) -> Matcher[Any]:
    """Return the matcher that the parameter `pairs` names.

    Procrustes for "both-ways", the paper's for "nearest".
    """
    return (
        ProcrustesMatcher(parameters) if parameters.matching.pairs == "both-ways" else TpsMatcher(parameters)
    )
