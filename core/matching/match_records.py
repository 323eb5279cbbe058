"""Match records: one array a shape, all that the Procrustes matcher reads of it.

The kernels release the GIL, so several threads may score at once.
"""

import hashlib
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bytes, Float32s, Floats, Int8s, Int16s, Ints
from core.embedding import Embedding, Scores
from core.errors import IncompatibleEmbeddingsError, ParameterError
from core.matching.kernels.match_record import HEAD, ONE, ROOT, MatchRecord
from core.matching.kernels.one_to_many import MATCH_RECORD, compare_many
from core.matching.kernels.spline_search import SearchRounds
from core.matching.quantised_points import encoded_points
from core.matching.similarity import EFFECTIVE
from core.matching.thin_plate_spline import compiled_spline_operators
from core.parameters import Parameters

TOGETHER = 32
"""Match records that are copied into one array for one call of the kernel."""


def embedding_key(embedding: Embedding) -> bytes:
    """Return a hash of the coordinates and of the samples that the points belong to, 16 bytes."""
    state = hashlib.blake2b(np.ascontiguousarray(embedding.regions).tobytes(), digest_size=16)
    for spectrum in embedding.spectra:
        state.update(np.ascontiguousarray(spectrum.coordinates).tobytes())
    return state.digest()


def match_record(embedding: Embedding, parameters: Parameters) -> Float32s:
    """Return the match record of an embedding, float32, shape (l,), about 31 kB.

    The bytes are the same only while linear algebra runs on one thread: see `core.numerics.guarding`. Raise
    IncompatibleEmbeddingsError for an embedding of other parameters, and ParameterError for parameters whose
    matcher has no match records.
    """
    if embedding.fingerprint != parameters.fingerprint:
        raise IncompatibleEmbeddingsError(
            f"embedding {embedding.fingerprint} under pipeline {parameters.fingerprint}"
        )
    if parameters.matching.pairs != "both-ways":
        raise ParameterError('only pipelines with pairs "both-ways" have match records')
    return encoded(make_match_record(embedding, embedding_key(embedding), parameters))


def encoded(record: MatchRecord) -> Float32s:
    """Return a match record as one array, float32, shape (l,), which `decoded` of the kernels reads.

    The points are quantised (`core.matching.quantised_points`); of the symmetric operators the lower
    triangles are kept.
    """
    b, j, s = record.searched.shape
    m, (d, columns) = len(record.offsets) - 1, record.points.shape
    regions = np.empty(d, dtype=np.int32)
    regions[record.members] = np.repeat(np.arange(m), np.diff(record.offsets))
    points = np.frombuffer(encoded_points(record.points, regions), dtype=np.uint8)
    head = np.zeros(HEAD, dtype=np.int32)
    head[:7] = m, len(points), s, b, columns // b, j, record.operators.shape[1]
    head[7:11] = record.key
    arrays = head, record.radius, points, _lower_triangles(record.operators), record.warp
    return np.concatenate([_floats(array) for array in arrays])


def _lower_triangles(matrices: Int16s) -> Int16s:
    """Return the lower triangles of matrices (..., m, m), row after row, shape (..., m (m + 1) / 2)."""
    m = matrices.shape[-1]
    return np.take(matrices.reshape(*matrices.shape[:-2], m * m), _lower_entries(m), axis=-1)


@lru_cache(maxsize=8)
def _lower_entries(m: int, diagonal: int = 0) -> Ints:
    """Return the indices of the entries up to a diagonal of a matrix (m, m), row after row."""
    return np.flatnonzero(np.tri(m, k=diagonal))


def _floats(array: NDArray[Any]) -> Float32s:
    """Return the bytes of an array as float32, filled up to whole numbers."""
    data = np.ascontiguousarray(array).tobytes()
    return np.frombuffer(data + bytes(-len(data) % 4), dtype=np.float32)


def make_match_record(embedding: Embedding, key: bytes, parameters: Parameters) -> MatchRecord:
    """Return the match record of one shape, in contiguous arrays that share no memory with the embedding.

    For arrays of another layout numba would compile the kernels again, to slower loops. The key is that of
    `embedding_key`.
    """
    regions, wanted = embedding.regions.astype(np.int64), parameters.matching
    m = int(regions.max()) + 1
    rows = min(wanted.search_samples or m, m)
    columns = wanted.search_dimensions or parameters.spectral.dimensions
    clouds = [spectrum.coordinates.astype(np.float64, order="C") for spectrum in embedding.spectra]
    samples = [points[:m] for points in clouds]
    searched = [points[:rows, :columns] for points in samples]
    centred = [points - points.mean(axis=0) for points in samples]
    splines = [compiled_spline_operators(p, wanted.first_dimensions, wanted.stiffness) for p in searched]
    softer = [compiled_spline_operators(p, p.shape[1], wanted.warp_stiffness)[0] for p in samples]
    return MatchRecord(
        points=np.ascontiguousarray(np.concatenate(clouds, axis=1), dtype=np.float32),
        searched=np.ascontiguousarray(np.stack([points.T for points in searched]), dtype=np.float32),
        operators=_quantised(splines),
        offsets=np.searchsorted(np.sort(regions), np.arange(m + 1)).astype(np.int32),
        members=np.argsort(regions, kind="stable").astype(np.int32),
        warp=np.stack([_cube_roots(matrix) for matrix in softer]),
        radius=np.array([np.linalg.norm(points, axis=1).mean() for points in centred], dtype=np.float32),
        key=np.frombuffer(key, dtype=">u4").astype(np.uint32).view(np.int32),
    )


def _quantised(matrices: Sequence[Floats]) -> Int16s:
    """Return matrices of entries in [-1, 1], stacked, in whole numbers over `ONE`."""
    return np.rint(np.clip(np.stack(matrices), -1.0, 1.0) * ONE).astype(np.int16)


def _cube_roots(matrix: Floats) -> Int8s:
    """Return the cube roots of the entries below the diagonal, of magnitude at most 1, over `ROOT`."""
    roots = np.rint(np.cbrt(np.take(matrix, _lower_entries(len(matrix), -1))) * ROOT)
    return np.asarray(np.clip(roots, 1 - ROOT, ROOT - 1), dtype=np.int8)


def search_rounds(parameters: Parameters) -> SearchRounds:
    """Return the sizes and numbers of rounds that the parameters ask for."""
    wanted = parameters.matching
    return SearchRounds(
        search_samples=wanted.search_samples or parameters.sampling.samples,
        first_dimensions=wanted.first_dimensions,
        starts=2**wanted.first_dimensions if wanted.sign_starts else 1,
        start_iterations=wanted.start_iterations,
        step_iterations=wanted.step_iterations,
        sides=2,
        align_samples=wanted.align_samples,
        kept_maps=wanted.kept_maps,
        align_rounds=wanted.align_rounds,
        final_rounds=wanted.final_rounds,
        slides=wanted.slide_rounds,
        effective=EFFECTIVE,
    )


def score_match_records(query: Float32s, records: Sequence[Float32s], parameters: Parameters) -> Scores:
    """Return CC, SSD and sim of one match record with each of c others, the same whichever is the query.

    All were made with the parameters.
    """
    rounds = search_rounds(parameters)
    scores = np.empty((len(records), 3))
    for start in range(0, len(records), TOGETHER):
        batch = records[start : start + TOGETHER]
        data = np.concatenate(batch, dtype=np.float32, casting="no").view(np.uint8)
        ends = np.cumsum([record.nbytes for record in batch])
        scores[start : start + TOGETHER] = compared(query, data, ends, MATCH_RECORD, rounds)[0]
    cc, ssd, sim = np.ascontiguousarray(scores.T)
    return Scores(cc=cc, ssd=ssd, sim=sim)


def compared(
    query: Float32s, others: Bytes, ends: Ints, form: int, rounds: SearchRounds
) -> tuple[Floats, Float32s]:
    """Return the scores of one shape with each of c others, shape (c, 3), and the map of the last pair.

    Parameters and results are those of `core.matching.kernels.one_to_many.compare_many`.
    """
    # Writeable: numba would compile the kernels once more for arrays that are not.
    record = np.require(query, requirements=["C", "W"])
    data = np.require(others, requirements=["C", "W"])
    columns = int(np.prod(record[3:5].view(np.int32)))
    scores, rotation = np.empty((len(ends), 3)), np.empty((columns, columns), dtype=np.float32)
    compare_many(record, data, ends, form, rounds, scores, rotation)
    return scores, rotation


def example_match_records(parameters: Parameters) -> list[Float32s]:
    """Return two match records of random points without splines, to run the kernels on."""
    m, d = 24, 40
    regions = np.arange(d, dtype=np.int32) % m
    wanted = parameters.matching
    domains, k = len(parameters.spectral.operators), parameters.spectral.dimensions
    s, j = min(wanted.search_samples or m, m), wanted.search_dimensions or k
    records = []
    for seed in range(2):
        points = np.random.default_rng(seed).standard_normal((d, domains * k), dtype=np.float32)
        record = MatchRecord(
            points=points,
            searched=np.empty((domains, j, s), dtype=np.float32),
            operators=np.zeros((domains, j - wanted.first_dimensions + 1, s, s), dtype=np.int16),
            offsets=np.searchsorted(np.sort(regions), np.arange(m + 1)).astype(np.int32),
            members=np.argsort(regions, kind="stable").astype(np.int32),
            warp=np.zeros((domains, m * (m - 1) // 2), dtype=np.int8),
            radius=np.ones(domains, dtype=np.float32),
            key=np.full(4, seed, dtype=np.int32),
        )
        records.append(encoded(record))
    return records
