"""The interface of the matchers, and the match of one pair of shapes."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from core.arrays import Floats, Int8s, Ints
from core.embedding import Embedding, Scores


@dataclass(frozen=True, eq=False)
class PairMatch:
    """The match of one pair of shapes.

    Attributes
    ----------
    cc, ssd, sim : float
        As in `core.embedding.Scores`.
    pairs : int64, shape (p, 2)
        Pairs (sample of the first shape, sample of the second).
    distances : float64, shape (p,)
    effective : bool, shape (p,)
        As in `core.embedding.Match`.
    mirrored : bool or None
        As in `core.embedding.Match`.
    """

    cc: float
    ssd: float
    sim: float
    pairs: Ints
    distances: Floats
    effective: NDArray[np.bool_]
    mirrored: bool | None = None

    def swapped(self) -> "PairMatch":
        """The same match seen from the other shape."""
        order = np.lexsort((self.pairs[:, 0], self.pairs[:, 1]))
        return replace(
            self,
            pairs=self.pairs[order][:, ::-1],
            distances=self.distances[order],
            effective=self.effective[order],
        )


class Prepared(Protocol):
    """A shape as its matcher reads it."""

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""


Shape = TypeVar("Shape", bound=Prepared)


class Matcher(Protocol[Shape]):
    """A method of matching embeddings under one set of parameters.

    A shape is prepared once, its splines factored, and then matched with any number of others. Scores are the
    same whichever of two shapes comes first: the matcher puts a pair in an order of its own (the smaller
    cloud, then the smaller `embedding_key`).
    """

    @property
    def uses_match_records(self) -> bool:
        """Whether a prepared shape is a match record: see `core.matching.match_records`.

        Match records are small enough to be cached for a whole archive, and are scored without the GIL.
        """

    def prepare(self, embedding: Embedding, key: bytes) -> Shape:
        """The embedding, whose `embedding_key` is `key`, with its splines factored."""

    def score(self, query: Shape, candidates: Iterable[Shape]) -> Scores:
        """CC, SSD and sim of one shape with each of c others: arrays of shape (c,)."""

    def match(
        self, first: Shape, second: Shape, orientations: tuple[Int8s, Int8s] | None = None
    ) -> PairMatch:
        """The scores of two shapes and their correspondence.

        With the orientations of both embeddings, int8 of shapes (m, p) and (n, p), the correspondence
        preserves orientation if a map that fits about as well as the best one does. Scores do not depend on
        them.
        """

    def candidates(
        self, first: Shape, second: Shape, orientations: tuple[Int8s, Int8s], most: int
    ) -> tuple[list[Ints], bool | None]:
        """Correspondences that fit about equally well, at most `most`, best first, each of shape (p, 2).

        Either all maps preserve orientation, or no map that fits about as well does. The second value is
        False or True accordingly, and None if the matcher does not use orientations. A sample may be in
        several pairs.
        """


def embedding_key(embedding: Embedding) -> bytes:
    """A hash of the coordinates and of the samples that the points belong to, 16 bytes."""
    state = hashlib.blake2b(np.ascontiguousarray(embedding.regions).tobytes(), digest_size=16)
    for spectrum in embedding.spectra:
        state.update(np.ascontiguousarray(spectrum.coordinates).tobytes())
    return state.digest()
