"""The arrays of a shape that the compiled matching reads, and the one-to-one pairs that are shown."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from core.embedding import Spectrum
from core.matching.kernels.match_record import ONE, ROOT
from core.matching.kernels.simd import SIMD_WIDTH
from core.matching.procrustes import one_to_one_pairs
from core.matching.similarity import EFFECTIVE
from core.matching.thin_plate_spline import spline_operators
from core.parameters import DEFAULT
from tests.core.matching.clouds import (
    cloud,
    compared_pair,
    embedded,
    parameters_for,
    random_embedding,
    random_record,
    record_of,
)

K = DEFAULT.spectral.dimensions
TYPES = {
    "points": np.float32,
    "searched": np.float32,
    "operators": np.float32,
    "offsets": np.int32,
    "members": np.int32,
    "warp": np.float32,
    "radius": np.float32,
    "key": np.int32,
}


def relaid(embedding, change):
    spectra = tuple(Spectrum(one.name, one.eigenvalues, change(one.coordinates)) for one in embedding.spectra)
    return replace(embedding, spectra=spectra)


def read_only(array):
    view = array.view()
    view.flags.writeable = False
    return view


@pytest.mark.parametrize("blocks", [1, 2, 3])
@pytest.mark.parametrize("layout", [np.ascontiguousarray, np.asfortranarray, read_only])
def test_arrays_are_of_one_type_and_layout_whatever_the_embedding_s(blocks, layout):
    """Others would compile the kernels anew, to slower loops."""
    given = relaid(random_embedding(0, 40, 90, blocks=blocks), layout)
    for name, array in record_of(given)._asdict().items():
        assert array.dtype == TYPES[name]
        assert array.flags.c_contiguous
        assert array.flags.writeable
        assert array.flags.aligned
        assert not any(np.shares_memory(array, one.coordinates) for one in given.spectra)
        assert not np.shares_memory(array, given.regions)


@pytest.mark.parametrize("blocks", [1, 2, 3])
@pytest.mark.parametrize(("m", "d"), [(12, 12), (20, 20), (32, 50), (70, 200)])
def test_a_pack_holds_points_regions_and_splines(m, d, blocks):
    """The search asks for more than 12 and 20 samples."""
    embedding = random_embedding(1, m, d, K, blocks)
    found = record_of(embedding)
    rows, columns = min(m, DEFAULT.matching.search_samples), DEFAULT.matching.search_dimensions
    stages = columns - DEFAULT.matching.first_dimensions + 1
    assert found.points.shape == (d, blocks * K)
    assert found.searched.shape == (blocks, columns, rows)
    assert found.operators.shape == (blocks, stages, rows, -(-rows // SIMD_WIDTH) * SIMD_WIDTH)
    assert not found.operators[..., rows:].any()
    assert found.warp.shape == (blocks, m, m)
    for place, spectrum in enumerate(embedding.spectra):
        points = spectrum.coordinates
        assert np.array_equal(found.points[:, place * K : place * K + K], points)
        assert np.array_equal(found.searched[place], points[:rows, :columns].T)
        of_samples = points.astype(np.float64)
        searched = spline_operators(
            of_samples[:rows, :columns], DEFAULT.matching.first_dimensions, DEFAULT.matching.stiffness
        )
        operators, beside = found.operators[place][..., :rows], ~np.eye(rows, dtype=bool)
        assert operators[:, beside] == pytest.approx(searched[:, beside], abs=0.51 / ONE)
        assert operators.sum(axis=-1) == pytest.approx(1.0, abs=1e-6)
        assert searched.sum(axis=-1) == pytest.approx(1.0, abs=1e-6)
        softer = spline_operators(of_samples[:m], K, DEFAULT.matching.warp_stiffness)[0]
        below = np.tril_indices(m, -1)
        roots = np.cbrt(found.warp[place][below])
        assert roots == pytest.approx(np.cbrt(softer[below]), abs=0.51 / ROOT)
        assert softer.sum(axis=1) == pytest.approx(1.0)
        centred = of_samples[:m] - of_samples[:m].mean(axis=0)
        assert found.radius[place] == pytest.approx(np.linalg.norm(centred, axis=1).mean(), rel=1e-6)
    for sample in range(m):
        region = found.members[found.offsets[sample] : found.offsets[sample + 1]]
        assert np.array_equal(region, np.flatnonzero(embedding.regions == sample))
        assert region[0] == sample
    assert found.offsets[-1] == len(found.members) == d


def test_splines_are_symmetric():
    """The search multiplies from the other side."""
    operators = record_of(random_embedding(2, 40, 90)).operators[..., : DEFAULT.matching.search_samples]
    assert np.array_equal(operators, np.swapaxes(operators, -1, -2))


def test_search_samples_of_nothing_are_all():
    everything = DEFAULT.with_values(matching={"search_samples": 0, "search_dimensions": 0})
    assert record_of(random_embedding(3, 40, 60), everything).searched.shape == (2, K, 40)


def rotated(k, seed):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(k, k)))[0].astype(np.float32)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("m", "n"), [(5, 5), (4, 7), (6, 6), (5, 7)])
def test_pairs_shown_are_the_best_of_all_one_to_one_pairs(m, n, seed):
    k = 2
    first, second = random_record(seed, m, m + 3, k, 2), random_record(50 + seed, n, n + 2, k, 2)
    rotation = np.kron(np.eye(2, dtype=np.float32), rotated(k, seed))
    squares = ((first.points[:m, None] @ rotation - second.points[None, :n]) ** 2).sum(axis=2)
    best = min(permutations(range(n), m), key=lambda to: squares[np.arange(m), list(to)].sum())
    matches, _, _ = one_to_one_pairs(first, second, rotation, same=False)
    assert matches.dtype == np.int64
    assert matches.tolist() == list(best)


def left(shape, partners):
    """How far the softer spline of the first domain, not rounded, leaves samples from their partners."""
    m, k = partners.shape
    softer = spline_operators(shape.points[:m, :k].astype(np.float64), k, DEFAULT.matching.warp_stiffness)[0]
    return np.linalg.norm(softer @ partners - partners, axis=1)


@pytest.mark.parametrize(("m", "n"), [(30, 30), (25, 40)])
def test_distances_shown_are_those_that_the_softer_spline_leaves(m, n):
    parameters = parameters_for(4)
    first, second = random_record(1, m, m + 20, 4, 2), random_record(2, n, n, 4, 2)
    _, rotation = compared_pair(first, second, parameters)
    matches, distances, effective = one_to_one_pairs(first, second, rotation, same=False)
    assert len(np.unique(matches)) == m
    expected = left(first, second.points[matches, :4])
    if m == n:
        back = left(second, (first.points[:m, :4] @ rotation[:4, :4])[np.argsort(matches)])
        expected = (expected + back[matches]) / 2
    # Splines have 8 bits.
    assert distances == pytest.approx(expected, abs=0.02)
    gamma = EFFECTIVE * (first.radius[0] + second.radius[0]) / 2
    assert np.array_equal(effective, distances <= gamma)
    assert 0 < effective.sum() < m


def test_a_shape_s_own_samples_are_shown_beside_themselves():
    """Even where points coincide, so that any order of theirs is as good."""
    points = cloud(4, 30, K)
    points[20:] = points[10:20]
    shape = record_of(embedded([points], 30))
    matches, distances, effective = one_to_one_pairs(shape, shape, np.eye(K, dtype=np.float32), same=True)
    assert np.array_equal(matches, np.arange(30))
    assert distances.shape == effective.shape == (30,)
