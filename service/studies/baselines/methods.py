"""The baselines by name. Each is loaded on demand: two of them need libraries of their own."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.mesh.mesh import Mesh

Floats = NDArray[np.float64]

Description = NDArray[Any]
"""The description of a shape; the method determines its type and dimensions."""


class BaselineName(StrEnum):
    """The name of a baseline."""

    SHAPEDNA = "shapedna"
    ICP = "icp"
    MDS = "mds"
    D2 = "d2"
    VIEWS = "views"


@dataclass(frozen=True)
class Baseline:
    """A method in two steps.

    Attributes
    ----------
    describe : Mesh -> Description
    compare : (description, descriptions of c others) -> float64, shape (c,)
        Distances; 0 for equal shapes.
    """

    describe: Callable[[Mesh], Description]
    compare: Callable[[Description, Sequence[Description]], Floats]


class MissingPeerError(Exception):
    """The library of a baseline is not installed; the message names it and the command that installs it."""


def load(method: BaselineName) -> Baseline:
    """Import a baseline.

    Raises
    ------
    MissingPeerError
        The library of the baseline is not installed.
    """
    try:
        match method:
            case BaselineName.SHAPEDNA:
                from service.studies.baselines import shapedna  # noqa: PLC0415  optional

                return Baseline(shapedna.describe, shapedna.compare)
            case BaselineName.ICP:
                from service.studies.baselines import icp  # noqa: PLC0415  beside the others

                return Baseline(icp.describe, icp.compare)
            case BaselineName.MDS:
                from service.studies.baselines import mds  # noqa: PLC0415  optional

                return Baseline(mds.describe, mds.compare)
            case BaselineName.D2:
                from service.studies.baselines import d2  # noqa: PLC0415  beside the others

                return Baseline(d2.describe, d2.compare)
            case BaselineName.VIEWS:
                from service.studies.baselines import views  # noqa: PLC0415  beside the others

                return Baseline(views.describe, views.compare)
    except ImportError as error:
        raise MissingPeerError(
            f"{method} needs {error.name}, which is not installed: pip install isoshape[peers]"
        ) from error
