"""The whole method: a mesh to its embedding, two embeddings to their match."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from core.embedding import Embedding, Match, Scores
from core.mesh import Mesh
from core.parameters import Parameters


class Pipeline:
    """The method under one set of parameters.

    Parameters
    ----------
    parameters : Parameters
        Frozen; `fingerprint` is a hash of them and of the method version.
    """

    parameters: Parameters
    fingerprint: str

    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self.fingerprint = parameters.fingerprint

    def embed(self, mesh: Mesh) -> Embedding: ...

    def score(self, query: Embedding, candidates: Sequence[Embedding]) -> Scores: ...

    def match(self, first: Embedding, second: Embedding) -> Match: ...

    def signature_distances(self, query: NDArray[np.float32], signatures: NDArray[np.float32]) -> NDArray[np.float64]: ...
