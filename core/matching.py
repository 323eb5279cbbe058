"""Two embeddings matched: one correspondence, alignment and scores in all their spectral domains."""

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.alignment import align, fit
from core.correspondence import progressive, smoothers
from core.embedding import Embedding, Float32s
from core.mesh import Floats, Ints
from core.parameters import Parameters
from core.similarity import correlation, effective_distance, effective_pairs, squared_difference
from core.sliding import Cloud, cloud, slide


@dataclass(frozen=True, eq=False)
class Domain:
    """The samples in one spectral domain, with their splines.

    Attributes
    ----------
    points : float64, shape (m, k)
    searched : float32, shape (s, j)
        The first samples and dimensions, where the search goes.
    operators : float32, shape (j - first_dimensions + 1, s, s)
        Their spline, factored: see `core.correspondence.smoothers`.
    warp : float32, shape (m, m)
        The softer spline in all k dimensions that sim reads one-to-one pairs under; with pairs "nearest" it
        is the last of `operators`.
    """

    points: Floats
    searched: Float32s
    operators: Float32s
    warp: Float32s

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return self.points.nbytes + self.searched.nbytes + self.operators.nbytes + self.warp.nbytes


@dataclass(frozen=True, eq=False)
class Prepared:
    """What matching needs of one shape, computed once and used for every other shape.

    Attributes
    ----------
    domains : tuple of Domain
        One a spectrum.
    cloud : Cloud
        All embedded points, the coordinates of the spectra side by side: shape (d, b k).
    key : bytes
        `embedding_key`, by which a pair is put in order.
    """

    domains: tuple[Domain, ...]
    cloud: Cloud
    key: bytes

    @property
    def samples(self) -> Floats:
        """The samples, shape (m, b k)."""
        return self.cloud.points[: len(self.domains[0].points)]

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return self.cloud.nbytes + sum(domain.nbytes for domain in self.domains)


@dataclass(frozen=True, eq=False)
class Found:
    """One pair of shapes; fields as in `core.embedding.Match`."""

    cc: float
    ssd: float
    sim: float
    pairs: Ints
    distances: Floats
    effective: NDArray[np.bool_]

    def swapped(self) -> "Found":
        """The same match seen from the other shape."""
        order = np.lexsort((self.pairs[:, 0], self.pairs[:, 1]))
        return Found(
            self.cc,
            self.ssd,
            self.sim,
            self.pairs[order][:, ::-1],
            self.distances[order],
            self.effective[order],
        )


def embedding_key(embedding: Embedding) -> bytes:
    """A hash of the coordinates and of the samples that the points belong to, 16 bytes."""
    state = hashlib.blake2b(np.ascontiguousarray(embedding.regions).tobytes(), digest_size=16)
    for spectrum in embedding.spectra:
        state.update(np.ascontiguousarray(spectrum.coordinates).tobytes())
    return state.digest()


def prepare(embedding: Embedding, key: bytes, parameters: Parameters) -> Prepared:
    """The embedding, whose `embedding_key` is `key`, with its splines factored."""
    regions = embedding.regions.astype(np.int64)
    samples = int(regions.max()) + 1
    clouds = [spectrum.coordinates.astype(np.float64) for spectrum in embedding.spectra]
    return Prepared(
        domains=tuple(_domain(np.ascontiguousarray(points[:samples]), parameters) for points in clouds),
        cloud=cloud(np.concatenate(clouds, axis=1), regions, embedding.graph_edges.astype(np.int64)),
        key=key,
    )


def _domain(points: Floats, parameters: Parameters) -> Domain:
    soft = parameters.pairs == "one-to-one"
    rows = parameters.search_samples if soft and parameters.search_samples else len(points)
    columns = parameters.search_dimensions if soft and parameters.search_dimensions else points.shape[1]
    searched = np.ascontiguousarray(points[:rows, :columns])
    operators = smoothers(searched, parameters.first_dimensions, parameters.stiffness)
    return Domain(
        points=points,
        searched=searched.astype(np.float32),
        operators=operators,
        warp=smoothers(points, parameters.dimensions, parameters.warp_stiffness)[0]
        if soft
        else operators[-1],
    )


def _search(first: Domain, second: Domain, parameters: Parameters) -> Ints:
    """A sample of the second for each searched one of the first (Eq. 17)."""
    return np.asarray(
        progressive(
            first.searched,
            second.searched,
            first.operators,
            parameters.first_dimensions,
            2**parameters.first_dimensions if parameters.sign_starts else 1,
            parameters.kept_starts,
            parameters.start_iterations,
            parameters.step_iterations,
        )
    )


def _starts(first: Prepared, second: Prepared, parameters: Parameters) -> list[Floats]:
    """Orthogonal maps to begin from: of a search in each domain from each side.

    A cloud against itself is not searched: where a shape has symmetries, rounding could find one of them.
    """
    x, y = first.samples, second.samples
    if first.key == second.key:
        return [np.eye(x.shape[1])]
    maps: list[Floats] = []
    for one, other in zip(first.domains, second.domains, strict=True):
        there = _search(one, other, parameters)
        maps.append(fit(x[: len(there)], y, there, len(first.domains))[1])
        back = _search(other, one, parameters)
        turned = fit(y[: len(back)], x, back, len(first.domains))[1]
        maps.append(np.ascontiguousarray(turned.T))
    return maps


def _warp_distances(source: Domain, targets: Floats) -> Floats:
    """How far the warp of the source points ends from the targets it was fitted to, shape (m,)."""
    return np.asarray(np.linalg.norm(source.warp @ targets - targets, axis=1))


def _aligned(first: Prepared, second: Prepared, parameters: Parameters) -> Found:
    """The best of several searches ended in one-to-one pairs, the same in all domains; m <= n.

    Then partners slide off the samples (`core.sliding`). CC and SSD read those pairs after the orthogonal
    map; sim counts the samples that the softer spline, either way, brings within gamma of their partners:
    where a smooth map explains the pairs, most are. All three are means over the domains.
    """
    blocks = len(first.domains)
    x, y = first.samples, second.samples
    found = [
        align(x, y, start, parameters.align_rounds, blocks) for start in _starts(first, second, parameters)
    ]
    _, matches, rotation = max(found, key=lambda one: float(one[0]))
    slid = slide(first.cloud, second.cloud, matches, rotation, parameters.slide_rounds, blocks)
    m = len(matches)
    inverse = np.argsort(matches) if len(x) == len(y) else None
    ssd: list[float] = []
    near: list[tuple[Floats, NDArray[np.bool_]]] = []
    for one, other, ends, targets in zip(
        first.domains,
        second.domains,
        np.split(slid.x, blocks, axis=1),
        np.split(slid.y, blocks, axis=1),
        strict=True,
    ):
        ssd.append(squared_difference(ends, targets))
        distances = _warp_distances(one, targets[:m])
        if inverse is not None:
            distances = 0.5 * (distances + _warp_distances(other, ends[m:][inverse])[matches])
        near.append((distances, distances <= effective_distance(one.points, other.points)))
    return Found(
        cc=slid.cc,
        ssd=float(np.mean(ssd)),
        sim=float(np.mean([effective.mean() for _, effective in near])),
        pairs=np.stack([np.arange(m), matches], axis=1),
        distances=near[0][0],
        effective=near[0][1],
    )


def _warped(
    first: Domain, second: Domain, parameters: Parameters
) -> tuple[float, float, float, Ints, Floats, NDArray[np.bool_]]:
    """The paper's comparison one way: CC, SSD, sim of the warped points and their nearest neighbours."""
    matches = _search(first, second, parameters)
    x = first.warp.astype(np.float64) @ second.points[matches]
    y = second.points[matches]
    distances = np.linalg.norm(x - y, axis=1)
    effective = effective_pairs(distances, matches, effective_distance(x, second.points))
    sim = float(effective.sum() / min(len(first.points), len(second.points)))
    return correlation(x, y), squared_difference(x, y), sim, matches, distances, effective


def _nearest(first: Prepared, second: Prepared, parameters: Parameters) -> Found:
    """Both ways of the paper's comparison in each domain, averaged.

    The pairs are those of the smaller cloud in the first domain.
    """
    there = [_warped(*pair, parameters) for pair in zip(first.domains, second.domains, strict=True)]
    back = [_warped(*pair, parameters) for pair in zip(second.domains, first.domains, strict=True)]
    cc, ssd, sim = np.mean([one[:3] for one in there + back], axis=0)
    _, _, _, matches, distances, effective = there[0]
    return Found(
        cc=float(cc),
        ssd=float(ssd),
        sim=float(sim),
        pairs=np.stack([np.arange(len(matches)), matches], axis=1),
        distances=distances,
        effective=effective,
    )


def match_prepared(first: Prepared, second: Prepared, parameters: Parameters) -> Found:
    """Scores and correspondence of two shapes, the same whichever comes first.

    The pair is put in an order of its own (the smaller cloud, then the smaller hash), so that both ways round
    the same numbers are computed.
    """
    turned = (len(first.samples), first.key) > (len(second.samples), second.key)
    pair = (second, first) if turned else (first, second)
    compare = _aligned if parameters.pairs == "one-to-one" else _nearest
    found = compare(*pair, parameters)
    return found.swapped() if turned else found
