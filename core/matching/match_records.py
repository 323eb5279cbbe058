"""One shape against many, each of them a row of numbers: `core.matching.kernels.match_record`.

The kernels let other threads run, so that several of these may be at work at once.
"""

from collections.abc import Sequence

import numpy as np

from core.arrays import Float32s, Ints
from core.embedding import Embedding, Scores
from core.errors import IncompatibleEmbeddingsError, ParameterError
from core.matching.kernels.match_record import packed_row
from core.matching.kernels.one_to_many import match_many
from core.matching.matcher import embedding_key
from core.matching.procrustes import pack, rounds_of
from core.parameters import Parameters


def row_of(embedding: Embedding, parameters: Parameters) -> Float32s:
    """What `match_rows` reads of an embedding, float32, shape (l,), about 100 kB.

    The bytes are the same only while linear algebra runs on one thread: see `core.numerics.threads`.

    Raises
    ------
    IncompatibleEmbeddingsError
        The embedding was made with other parameters.
    ParameterError
        Rows are of parameters with pairs "both-ways".
    """
    if embedding.fingerprint != parameters.fingerprint:
        raise IncompatibleEmbeddingsError(
            f"embedding {embedding.fingerprint} under pipeline {parameters.fingerprint}"
        )
    if parameters.matching.pairs != "both-ways":
        raise ParameterError('rows are of parameters with pairs "both-ways"')
    return packed_row(pack(embedding, embedding_key(embedding), parameters))


def match_rows(query: Float32s, rows: Sequence[Float32s], parameters: Parameters) -> Scores:
    """CC, SSD and sim of one shape with each of c others, the same whichever of two is the query.

    Parameters
    ----------
    query : float32, shape (l,)
    rows : sequence of float32, each of a shape (l,)
    parameters : Parameters
        With pairs "both-ways", those that all rows were made with.
    """
    addresses, lengths = _places(rows)
    scores = np.empty((len(rows), 3))
    match_many(_own(query), addresses, lengths, rounds_of(parameters), scores)
    return Scores(cc=scores[:, 0].copy(), ssd=scores[:, 1].copy(), sim=scores[:, 2].copy())


def _places(rows: Sequence[Float32s]) -> tuple[Ints, Ints]:
    """Where the rows lie in memory, and how long they are."""
    if not all(row.flags.c_contiguous and row.dtype == np.float32 for row in rows):
        raise ValueError("a row is not of float32 side by side")
    addresses = [row.__array_interface__["data"][0] for row in rows]
    return np.array(addresses, dtype=np.int64), np.array([len(row) for row in rows], dtype=np.int64)


def _own(query: Float32s) -> Float32s:
    """The row in memory that may be written to: of other arrays the kernels would be compiled anew."""
    return np.require(query, requirements=["C", "W"])
