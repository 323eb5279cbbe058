"""The choice between the matchers, made here alone."""

from typing import Any

from core.matching.matcher import Matcher
from core.matching.procrustes import ProcrustesMatcher
from core.matching.tps_matcher import TpsMatcher
from core.parameters import Parameters


def matcher_of(parameters: Parameters) -> Matcher[Any]:
    """The matcher that the parameter `pairs` names: Procrustes for "both-ways", the paper's for "nearest"."""
    return (
        ProcrustesMatcher(parameters) if parameters.matching.pairs == "both-ways" else TpsMatcher(parameters)
    )
