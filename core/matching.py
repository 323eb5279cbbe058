"""Two embeddings matched: alignment, correspondence and scores in one spectral domain."""

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.alignment import align, procrustes
from core.correspondence import progressive, smoothers
from core.embedding import Float32s, Int32s, Spectrum
from core.mesh import Floats, Ints
from core.parameters import Parameters
from core.similarity import correlation, effective_distance, effective_pairs, squared_difference
from core.sliding import Cloud, cloud, slide


@dataclass(frozen=True, eq=False)
class Prepared:
    """What matching needs of one spectrum, computed once and used for every other shape.

    Attributes
    ----------
    points : float64, shape (m, k)
        The samples.
    single : float32, shape (m, k)
        The same.
    cloud : Cloud
        All embedded points: centred, unit root mean square radius.
    operators : float32, shape (k - first_dimensions + 1, m, m)
        The spline, factored: see `core.correspondence.smoothers`.
    warp : float32, shape (m, m)
        The softer spline in all k dimensions that sim reads one-to-one pairs under; with pairs "nearest" it
        is the last of `operators`.
    key : bytes
        `spectrum_key`, by which a pair is put in order.
    """

    points: Floats
    single: Float32s
    cloud: Cloud
    operators: Float32s
    warp: Float32s
    key: bytes

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return self.cloud.nbytes + self.single.nbytes + self.operators.nbytes + self.warp.nbytes


@dataclass(frozen=True, eq=False)
class SpectralMatch:
    """One pair in one spectral domain; fields as in `core.embedding.Match`."""

    cc: float
    ssd: float
    sim: float
    pairs: Ints
    distances: Floats
    effective: NDArray[np.bool_]

    def swapped(self) -> "SpectralMatch":
        """The same match seen from the other shape."""
        order = np.lexsort((self.pairs[:, 0], self.pairs[:, 1]))
        return SpectralMatch(
            self.cc,
            self.ssd,
            self.sim,
            self.pairs[order][:, ::-1],
            self.distances[order],
            self.effective[order],
        )


def spectrum_key(spectrum: Spectrum, regions: Int32s) -> bytes:
    """A hash of the coordinates and of the samples that the points belong to, 16 bytes."""
    state = hashlib.blake2b(np.ascontiguousarray(spectrum.coordinates).tobytes(), digest_size=16)
    state.update(np.ascontiguousarray(regions).tobytes())
    return state.digest()


def prepare(
    spectrum: Spectrum, regions: Int32s, edges: Int32s, key: bytes, parameters: Parameters
) -> Prepared:
    """The spectrum, whose `spectrum_key` is `key`, with its splines factored.

    Regions and edges are the embedding's `regions` and `graph_edges`.
    """
    points = np.ascontiguousarray(spectrum.coordinates, dtype=np.float64)
    near = cloud(points, regions.astype(np.int64), edges.astype(np.int64))
    samples = points[: int(regions.max()) + 1]
    operators = smoothers(samples, parameters.first_dimensions, parameters.stiffness)
    soft = parameters.pairs == "one-to-one"
    return Prepared(
        points=samples,
        single=samples.astype(np.float32),
        cloud=near,
        operators=operators,
        warp=smoothers(samples, parameters.dimensions, parameters.warp_stiffness)[0]
        if soft
        else operators[-1],
        key=key,
    )


def _search(first: Prepared, second: Prepared, parameters: Parameters) -> Ints:
    return np.asarray(
        progressive(
            first.single,
            second.single,
            first.operators,
            parameters.first_dimensions,
            2**parameters.first_dimensions if parameters.sign_starts else 1,
            parameters.kept_starts,
            parameters.start_iterations,
            parameters.step_iterations,
        )
    )


def _warp_distances(source: Prepared, targets: Floats) -> Floats:
    """How far the warp of the source points ends from the targets it was fitted to, shape (m,)."""
    return np.asarray(np.linalg.norm(source.warp @ targets - targets, axis=1))


def _aligned(first: Prepared, second: Prepared, parameters: Parameters) -> SpectralMatch:
    """The better of two searches, one from each side, ended in one-to-one pairs; m <= n.

    A cloud against itself is not searched: where a shape has symmetries, rounding could find one of them.

    Then partners slide off the samples (`core.sliding`). CC and SSD read those pairs after the orthogonal
    map; sim counts the samples that the softer spline, either way, brings within gamma of their partners:
    where a smooth map explains the pairs, most are.
    """
    if first.key == second.key:
        starts = [np.eye(first.points.shape[1])]
    else:
        there, back = _search(first, second, parameters), _search(second, first, parameters)
        starts = [
            procrustes(first.points, second.points[there]),
            procrustes(first.points[back], second.points),
        ]
    found = [align(first.points, second.points, start, parameters.align_rounds) for start in starts]
    cc, matches, rotation = max(found, key=lambda one: float(one[0]))
    if parameters.slide_rounds:
        slid = slide(first.cloud, second.cloud, matches, rotation, parameters.slide_rounds)
        cc, x, y = slid.cc, slid.x, slid.y
    else:
        x, y = np.tile(first.points @ rotation, (2, 1)), np.tile(second.points[matches], (2, 1))
    m = len(matches)
    distances = _warp_distances(first, y[:m])
    if len(first.points) == len(second.points):
        inverse = np.argsort(matches)
        distances = 0.5 * (distances + _warp_distances(second, x[m:][inverse])[matches])
    effective = distances <= effective_distance(first.points, second.points)
    return SpectralMatch(
        cc=float(cc),
        ssd=squared_difference(x, y),
        sim=float(effective.mean()),
        pairs=np.stack([np.arange(len(matches)), matches], axis=1),
        distances=distances,
        effective=effective,
    )


def _warped(
    first: Prepared, second: Prepared, parameters: Parameters
) -> tuple[float, float, float, Ints, Floats, NDArray[np.bool_]]:
    """The paper's comparison one way: CC, SSD, sim of the warped points and their nearest neighbours."""
    matches = _search(first, second, parameters)
    x = first.warp.astype(np.float64) @ second.points[matches]
    y = second.points[matches]
    distances = np.linalg.norm(x - y, axis=1)
    effective = effective_pairs(distances, matches, effective_distance(x, second.points))
    sim = float(effective.sum() / min(len(first.points), len(second.points)))
    return correlation(x, y), squared_difference(x, y), sim, matches, distances, effective


def _nearest(first: Prepared, second: Prepared, parameters: Parameters) -> SpectralMatch:
    """Both ways of the paper's comparison, averaged; the pairs are those of the smaller cloud."""
    there, back = _warped(first, second, parameters), _warped(second, first, parameters)
    return SpectralMatch(
        cc=0.5 * (there[0] + back[0]),
        ssd=0.5 * (there[1] + back[1]),
        sim=0.5 * (there[2] + back[2]),
        pairs=np.stack([np.arange(len(there[3])), there[3]], axis=1),
        distances=there[4],
        effective=there[5],
    )


def match_spectra(first: Prepared, second: Prepared, parameters: Parameters) -> SpectralMatch:
    """Scores and correspondence of two clouds, the same whichever comes first.

    The pair is put in an order of its own (the smaller cloud, then the smaller hash), so that both ways round
    the same numbers are computed.
    """
    turned = (len(first.points), first.key) > (len(second.points), second.key)
    pair = (second, first) if turned else (first, second)
    compare = _aligned if parameters.pairs == "one-to-one" else _nearest
    found = compare(*pair, parameters)
    return found.swapped() if turned else found
