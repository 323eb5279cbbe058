"""Match records: one array a shape, all that the Procrustes matcher reads of it.

The kernels release the GIL, so several threads may score at once.
"""

import hashlib
from collections.abc import Sequence

import numpy as np

from core.arrays import Bytes, Float32s, Floats, Int8s, Int16s, Int32s, Ints
from core.embedding import Embedding, Scores
from core.errors import BadRecordError, IncompatibleEmbeddingsError, ParameterError
from core.matching.kernels.match_record import HEAD, ONE, ROOT
from core.matching.kernels.one_to_many import MATCH_RECORD, compare_many
from core.matching.kernels.spline_search import SearchRounds
from core.matching.quantised_points import EmbeddedPoints, decoded_points, encoded_points, quantised_points
from core.matching.similarity import EFFECTIVE
from core.matching.thin_plate_spline import compiled_spline_operators
from core.numerics.compilation import compiled
from core.parameters import Parameters

TOGETHER = 32
"""Match records that are copied into one array for one call of the kernel."""

THIRD = np.int32(709921077)
"""Added to a third of the bits of a float32 number, it gives the bits of its cube root to within 4 %."""


def embedding_key(embedding: Embedding) -> bytes:
    """Return a hash of the coordinates and of the samples that the points belong to, 16 bytes."""
    return _key(embedding.regions, [spectrum.coordinates for spectrum in embedding.spectra])


def _key(regions: Int32s, clouds: Sequence[Float32s]) -> bytes:
    state = hashlib.blake2b(np.ascontiguousarray(regions).tobytes(), digest_size=16)
    for cloud in clouds:
        state.update(np.ascontiguousarray(cloud).tobytes())
    return state.digest()


def match_record(embedding: Embedding, parameters: Parameters) -> Float32s:
    """Return the match record of an embedding, float32, shape (l,), about 30 kB.

    The bytes are the same only while linear algebra runs on one thread: see `core.numerics.guarding`. Raise
    IncompatibleEmbeddingsError for an embedding of other parameters, and ParameterError for parameters whose
    matcher has no match records.
    """
    _require_records(embedding.fingerprint, parameters)
    return keyed_match_record(embedding, embedding_key(embedding), parameters)


def match_record_of_points(points: EmbeddedPoints, parameters: Parameters) -> Float32s:
    """Return the match record of the embedding with these points, as `match_record` does.

    Raise BadRecordError for bytes that are not points.
    """
    _require_records(points.fingerprint, parameters)
    try:
        coordinates, regions = decoded_points(points.data)
        clouds = np.split(coordinates, points.domains, axis=1)
    except ValueError as error:
        raise BadRecordError(f"not embedded points: {error}") from error
    return _encoded(points.data, clouds, int(regions.max()) + 1, _key(regions, clouds), parameters)


def keyed_match_record(embedding: Embedding, key: bytes, parameters: Parameters) -> Float32s:
    """Return the match record of an embedding whose `embedding_key` is `key`."""
    clouds = [spectrum.coordinates for spectrum in embedding.spectra]
    return _encoded(quantised_points(embedding), clouds, int(embedding.regions.max()) + 1, key, parameters)


def _require_records(fingerprint: str, parameters: Parameters) -> None:
    if fingerprint != parameters.fingerprint:
        raise IncompatibleEmbeddingsError(f"embedding {fingerprint} under pipeline {parameters.fingerprint}")
    if parameters.matching.pairs != "both-ways":
        raise ParameterError('only pipelines with pairs "both-ways" have match records')


def _encoded(
    points: bytes, clouds: Sequence[Float32s], m: int, key: bytes, parameters: Parameters
) -> Float32s:
    """Return a match record as one array, float32, shape (l,), which `decoded` of the kernels reads.

    The rows of the symmetric splines sum to 1, so the entries below the diagonal are enough.

    Parameters
    ----------
    points : bytes
        Of `core.matching.quantised_points`.
    clouds : sequence
        The same points in each of b domains, float32, shape (d, k); the m samples come first.
    m : int
    key : bytes
        The `embedding_key`.
    parameters : Parameters
    """
    wanted = parameters.matching
    rows = min(wanted.search_samples or m, m)
    columns = wanted.search_dimensions or parameters.spectral.dimensions
    operators, warp, radius = [], [], []
    for cloud in clouds:
        samples = cloud[:m].astype(np.float64, order="C")
        searched = samples[:rows, :columns]
        stages = compiled_spline_operators(searched, wanted.first_dimensions, wanted.stiffness)
        operators.append(stages[:, np.tri(len(searched), k=-1) > 0.0].ravel())
        (softer,) = compiled_spline_operators(samples, samples.shape[1], wanted.warp_stiffness)
        warp.append(_cube_roots(softer))
        radius.append(np.linalg.norm(samples - samples.mean(axis=0), axis=1).mean())
    head = np.zeros(HEAD, dtype=np.int32)
    head[:7] = m, len(points), rows, len(clouds), clouds[0].shape[1], searched.shape[1], len(stages)
    head[7:11] = np.frombuffer(key, dtype=">u4").astype(np.uint32).view(np.int32)
    arrays = (
        head,
        np.array(radius, dtype=np.float32),
        _packed(np.concatenate(operators)),
        np.concatenate(warp),
    )
    head_bytes, radius_bytes, operator_bytes, warp_bytes = (_filled(array.tobytes()) for array in arrays)
    data = b"".join((head_bytes, radius_bytes, points, operator_bytes, warp_bytes))
    return np.frombuffer(data, dtype=np.float32)


def _filled(data: bytes) -> bytes:
    """Return bytes filled up to a multiple of four."""
    return data + bytes(-len(data) % 4)


def _packed(entries: Floats) -> Int16s:
    """Return numbers in [-1/2, 1/2] over `ONE` in 14 bits, as the kernels' `whole_entries` reads them."""
    filled = np.append(entries, np.zeros(-len(entries) % 8))
    whole = np.clip(np.rint(filled * ONE), -(ONE // 2), ONE // 2).astype(np.int16).reshape(8, -1)
    bits = (whole[7] >> np.arange(0, 14, 2, dtype=np.int16)[:, None]) & 3
    return np.asarray(whole[:7] << 2 | bits, dtype=np.int16)


@compiled
def _cube_roots(matrix: Floats) -> Int8s:
    """Return the cube roots of the entries below the diagonal, of magnitude at most 1/2, over `ROOT`.

    By two steps of Halley's method from a third of the exponent, in under half of the time of `np.cbrt`.
    """
    m = len(matrix)
    roots = np.empty(m * (m - 1) // 2, dtype=np.int8)
    guess = np.empty(m, dtype=np.float32)
    bits = guess.view(np.int32)
    place = 0
    for i in range(m):
        for j in range(i):
            guess[j] = abs(matrix[i, j])
        for j in range(i):
            bits[j] = np.int32(bits[j] // np.int32(3) + THIRD)
        for j in range(i):
            size = abs(matrix[i, j])
            root = np.float64(guess[j])
            for _ in range(2):
                cube = root * root * root
                root *= (cube + 2.0 * size) / (2.0 * cube + size)
            whole = min(np.rint(root * ROOT), 127.0)
            roots[place + j] = np.int8(whole if matrix[i, j] >= 0.0 else -whole)
        place += i
    return roots


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
    """Return two match records of random points, to run the kernels on."""
    m, d = 24, 40
    regions = np.arange(d, dtype=np.int32) % m
    domains, k = len(parameters.spectral.operators), parameters.spectral.dimensions
    records = []
    for seed in range(2):
        points = np.random.default_rng(seed).standard_normal((d, domains * k), dtype=np.float32)
        data = encoded_points(points, regions)
        records.append(_encoded(data, np.split(points, domains, axis=1), m, bytes([seed] * 16), parameters))
    return records
