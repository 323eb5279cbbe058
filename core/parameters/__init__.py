"""The parameters of the method.

Keywords, a JSON object or a stored dictionary in; a frozen, validated `Parameters` with a fingerprint out.
"""

from core.parameters.groups import (
    MatchingParameters,
    MeshParameters,
    RankingParameters,
    SamplingParameters,
    SpectralParameters,
)
from core.parameters.parameters import DEFAULT, EARLIER_VALUES, METHOD_VERSION, PAPER, Parameters

__all__ = [
    "DEFAULT",
    "EARLIER_VALUES",
    "METHOD_VERSION",
    "PAPER",
    "MatchingParameters",
    "MeshParameters",
    "Parameters",
    "RankingParameters",
    "SamplingParameters",
    "SpectralParameters",
]
