"""Partners between the samples: each sample's partner moves to the embedded point that fits it best.

Two meshes of one shape have their samples at different places, so even the best pairs of samples lie half a
sample's spacing apart. Shapes carry some hundred more embedded points than samples, and this last step lets
the partner of a sample be any of them near the sample that it was paired with.
"""

from dataclasses import dataclass

import numpy as np

from core.alignment import fit, fit_reference
from core.compiled import compiled
from core.mesh import Floats, Ints


@dataclass(frozen=True, eq=False)
class Cloud:
    """The embedded points of one shape, and which of them lie near each sample.

    Attributes
    ----------
    points : float64, shape (d, k)
        The samples first.
    offsets : int64, shape (m + 1,)
        Sample i's points are `near[offsets[i]:offsets[i + 1]]`.
    near : int64
        Those of its own region, and of the regions that touch it.
    """

    points: Floats
    offsets: Ints
    near: Ints

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return self.points.nbytes + self.offsets.nbytes + self.near.nbytes


def cloud(points: Floats, regions: Ints, edges: Ints) -> Cloud:
    """The points near each sample.

    Parameters
    ----------
    points : float64, shape (d, k)
    regions : int64, shape (d,)
        The sample nearest to each point, which for the samples themselves, the first m, is their own number.
    edges : int64, shape (e, 2)
        Pairs of samples whose regions touch.
    """
    samples = int(regions.max()) + 1
    touches = np.eye(samples, dtype=bool)
    touches[edges[:, 0], edges[:, 1]] = touches[edges[:, 1], edges[:, 0]] = True
    sample, point = np.nonzero(touches[:, regions])
    offsets = np.searchsorted(sample, np.arange(samples + 1))
    return Cloud(np.ascontiguousarray(points), offsets.astype(np.int64), point.astype(np.int64))


@compiled
def _closest(points: Floats, x: Floats, near: Ints) -> int:
    """Of the rows `near` of `points` that which is closest to x."""
    least = np.inf
    best = -1
    for j in near:
        square = 0.0
        for c in range(len(x)):
            step = points[j, c] - x[c]
            square += step * step
        if square < least:
            least = square
            best = j
    return best


@compiled
def _partners(points: Floats, offsets: Ints, near: Ints, samples: Ints, x: Floats) -> Ints:
    """For each row of x the closest of the points near the sample that `samples` names, shape (m,)."""
    found = np.empty(len(x), dtype=np.int64)
    for i in range(len(x)):
        s = samples[i]
        found[i] = _closest(points, x[i], near[offsets[s] : offsets[s + 1]])
    return found


@dataclass(frozen=True, eq=False)
class Slid:
    """Pairs of which one end is a sample and the other any embedded point, after the orthogonal map.

    Attributes
    ----------
    cc : float
        Correlation of the 2 m pairs, the mean over the blocks, in [0, 1].
    x, y : float64, shape (2 m, blocks k)
        Both ends of each pair: first the samples of the first shape and their partners, then the sources
        and the samples of the second shape that `matches` names.
    """

    cc: float
    x: Floats
    y: Floats


def slide(first: Cloud, second: Cloud, matches: Ints, rotation: Floats, rounds: int, blocks: int) -> Slid:
    """Each sample's partner moved to the nearest embedded point about it, both ways, and the map fitted anew.

    Parameters
    ----------
    first, second : Cloud
        Of `blocks` embeddings side by side, as for `core.alignment.align`.
    matches : int64, shape (m,)
        A sample of the second for each of the first, all different.
    rotation : float64, shape (blocks k, blocks k)
        Orthogonal: first.points @ rotation lies near second.points.
    rounds : int
        How often partners and map are fitted in turn; 0 leaves the partners at the samples.
    blocks : int
    """
    m = len(matches)
    own = np.arange(m)
    x = np.concatenate([first.points[:m], first.points[:m]])
    y = np.concatenate([second.points[matches], second.points[matches]])
    pairs = np.arange(2 * m)
    cc = 0.0
    if not rounds:
        cc, rotation = fit(x, y, pairs, blocks)
    for _ in range(rounds):
        turned = first.points[:m] @ rotation
        back = second.points[matches] @ np.ascontiguousarray(rotation.T)
        y[:m] = second.points[_partners(second.points, second.offsets, second.near, matches, turned)]
        x[m:] = first.points[_partners(first.points, first.offsets, first.near, own, back)]
        cc, rotation = fit(x, y, pairs, blocks)
    return Slid(cc=cc, x=x @ rotation, y=y)


def slide_reference(
    first: Cloud, second: Cloud, matches: Ints, rotation: Floats, rounds: int, blocks: int
) -> Slid:
    """What `slide` finds for one round or more, in plain NumPy."""
    m = len(matches)
    near_first = [first.near[first.offsets[i] : first.offsets[i + 1]] for i in range(m)]
    near_second = [second.near[second.offsets[j] : second.offsets[j + 1]] for j in matches]
    cc, x, y = 0.0, first.points[:m], second.points[matches]
    for _ in range(rounds):
        partners = [
            near[np.argmin(((second.points[near] - point) ** 2).sum(axis=1))]
            for near, point in zip(near_second, first.points[:m] @ rotation, strict=True)
        ]
        sources = [
            near[np.argmin(((first.points[near] - point) ** 2).sum(axis=1))]
            for near, point in zip(near_first, second.points[matches] @ rotation.T, strict=True)
        ]
        x = np.concatenate([first.points[:m], first.points[sources]])
        y = np.concatenate([second.points[partners], second.points[matches]])
        cc, rotation = fit_reference(x, y, np.arange(2 * m), blocks)
    return Slid(cc, x @ rotation, y)
