"""The other methods by name, loaded when asked for: two of them need libraries that nothing else does."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from core.mesh.mesh import Mesh

Floats = NDArray[np.float64]


class Method(StrEnum):
    """A method that is not this project's own."""

    SHAPEDNA = "shapedna"
    ICP = "icp"
    MDS = "mds"


@dataclass(frozen=True)
class Rival:
    """A method in two steps.

    Attributes
    ----------
    describe : Mesh -> float64 array
        What is kept of a shape; the shape of the array is the method's own.
    compare : (description, descriptions of c others) -> float64, shape (c,)
        Distances, 0 for the same shape.
    """

    describe: Callable[[Mesh], Floats]
    compare: Callable[[Floats, Sequence[Floats]], Floats]


class MissingPeerError(Exception):
    """A library that only a comparison needs is not installed; the message says which, and how to get it."""


def load(method: Method) -> Rival:
    """The method, ready to be used.

    Raises
    ------
    MissingPeerError
        Its library is not installed.
    """
    try:
        match method:
            case Method.SHAPEDNA:
                from service.studies.baselines import shapedna  # noqa: PLC0415  optional

                return Rival(shapedna.describe, shapedna.compare)
            case Method.ICP:
                from service.studies.baselines import icp  # noqa: PLC0415  beside the others

                return Rival(icp.describe, icp.compare)
            case Method.MDS:
                from service.studies.baselines import mds  # noqa: PLC0415  optional

                return Rival(mds.describe, mds.compare)
    except ImportError as error:
        raise MissingPeerError(
            f"{method} needs {error.name}, which is not installed: pip install isoshape[peers]"
        ) from error
