"""Match records: one array a shape, all that the Procrustes matcher reads of it.

The kernels release the GIL, so several threads may score at once.
"""

from collections.abc import Sequence

from core.arrays import Float32s
from core.embedding import Embedding, Scores
from core.errors import IncompatibleEmbeddingsError, ParameterError
from core.matching.matcher import embedding_key
from core.matching.matcher_choice import matcher_of
from core.matching.procrustes import ProcrustesMatcher
from core.parameters import Parameters


def match_record(embedding: Embedding, parameters: Parameters) -> Float32s:
    """The match record of an embedding, float32, shape (l,), about 100 kB.

    The bytes are the same only while linear algebra runs on one thread: see `core.numerics.threads`.

    Raises
    ------
    IncompatibleEmbeddingsError
        The embedding was made with other parameters.
    ParameterError
        The matcher of the parameters has no match records.
    """
    if embedding.fingerprint != parameters.fingerprint:
        raise IncompatibleEmbeddingsError(
            f"embedding {embedding.fingerprint} under pipeline {parameters.fingerprint}"
        )
    if not matcher_of(parameters).uses_match_records:
        raise ParameterError('only pipelines with pairs "both-ways" have match records')
    return ProcrustesMatcher(parameters).prepare(embedding, embedding_key(embedding))


def score_match_records(query: Float32s, records: Sequence[Float32s], parameters: Parameters) -> Scores:
    """CC, SSD and sim of one shape with each of c others, the same whichever of two is the query.

    Parameters
    ----------
    query : float32, shape (l,)
    records : sequence of float32, each of a shape (l,)
    parameters : Parameters
        Those that all match records were made with.
    """
    return ProcrustesMatcher(parameters).score(query, records)
