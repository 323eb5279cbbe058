"""Two embeddings matched: the scores, and the correspondence that is shown."""

import hashlib
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Floats, Ints
from core.embedding import Embedding
from core.matching.kernels.match_record import Packed, packed_row, unpacked
from core.matching.procrustes import matched, pack, shown_pairs
from core.matching.tps_matcher import Domain, domains, warped
from core.parameters import Parameters


@dataclass(frozen=True, eq=False)
class Prepared:
    """What matching needs of one shape, computed once and used for every other shape.

    Attributes
    ----------
    samples : int
        m.
    key : bytes
        `embedding_key`, by which a pair is put in order.
    shape : float32, shape (l,), or tuple of Domain
        With pairs "both-ways" a row of `core.matching.match_records`, with "nearest" the domains.
    """

    samples: int
    key: bytes
    shape: Float32s | tuple[Domain, ...]

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return (
            self.shape.nbytes if isinstance(self.shape, np.ndarray) else sum(one.nbytes for one in self.shape)
        )


@dataclass(frozen=True, eq=False)
class Found:
    """One pair of shapes; fields as in `core.embedding.Match`. Without pairs where only scores were asked."""

    cc: float
    ssd: float
    sim: float
    pairs: Ints
    distances: Floats
    effective: NDArray[np.bool_]

    def swapped(self) -> "Found":
        """The same match seen from the other shape."""
        order = np.lexsort((self.pairs[:, 0], self.pairs[:, 1]))
        return replace(
            self,
            pairs=self.pairs[order][:, ::-1],
            distances=self.distances[order],
            effective=self.effective[order],
        )


def embedding_key(embedding: Embedding) -> bytes:
    """A hash of the coordinates and of the samples that the points belong to, 16 bytes."""
    state = hashlib.blake2b(np.ascontiguousarray(embedding.regions).tobytes(), digest_size=16)
    for spectrum in embedding.spectra:
        state.update(np.ascontiguousarray(spectrum.coordinates).tobytes())
    return state.digest()


def prepare(embedding: Embedding, key: bytes, parameters: Parameters) -> Prepared:
    """The embedding, whose `embedding_key` is `key`, with its splines factored."""
    both = parameters.matching.pairs == "both-ways"
    return Prepared(
        samples=int(embedding.regions.max()) + 1,
        key=key,
        shape=packed_row(pack(embedding, key, parameters)) if both else domains(embedding, parameters),
    )


def match_prepared(first: Prepared, second: Prepared, parameters: Parameters, *, pairs: bool = True) -> Found:
    """Scores of two shapes, and their correspondence if wanted, the same whichever comes first.

    The pair is put in an order of its own (the smaller cloud, then the smaller hash), so that both ways round
    the same numbers are computed.
    """
    turned = (first.samples, first.key) > (second.samples, second.key)
    x, y = (second, first) if turned else (first, second)
    if isinstance(x.shape, np.ndarray) and isinstance(y.shape, np.ndarray):
        same = x.key == y.key
        found = _both_ways(unpacked(x.shape), unpacked(y.shape), parameters, same=same, pairs=pairs)
    else:
        found = _nearest(x, y, parameters)
    return found.swapped() if turned else found


def _both_ways(x: Packed, y: Packed, parameters: Parameters, *, same: bool, pairs: bool) -> Found:
    """CC, SSD and sim read each sample's nearest partner, from either shape; shown are one-to-one pairs."""
    found = matched(x, y, parameters, same=same)
    matches, distances, effective = np.empty(0, dtype=np.int64), np.empty(0), np.empty(0, dtype=np.bool_)
    if pairs:
        matches, distances, effective = shown_pairs(x, y, found.rotation, same=same)
    cc, ssd, sim = found.scores.tolist()
    return Found(cc, ssd, sim, np.stack([np.arange(len(matches)), matches], 1), distances, effective)


def _nearest(x: Prepared, y: Prepared, parameters: Parameters) -> Found:
    """Both ways of the paper's comparison in each domain, averaged.

    The pairs are those of the smaller cloud in the first domain.
    """
    firsts, seconds = (tuple(domain for domain in one.shape if isinstance(domain, Domain)) for one in (x, y))
    there = [warped(*pair, parameters) for pair in zip(firsts, seconds, strict=True)]
    back = [warped(*pair, parameters) for pair in zip(seconds, firsts, strict=True)]
    cc, ssd, sim = np.mean([one.scores for one in there + back], axis=0).tolist()
    shown = there[0]
    pairs = np.stack([np.arange(len(shown.matches)), shown.matches], axis=1)
    return Found(cc, ssd, sim, pairs, shown.distances, shown.effective)
