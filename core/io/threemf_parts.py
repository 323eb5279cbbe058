"""The distinct objects of a 3MF, with their names and numbers of instances."""

import math
from collections.abc import Callable, Iterator

import numpy as np

from core.arrays import Floats
from core.io.checks import Limits
from core.io.part import PATH_NAMES, Part, distinct_parts, mesh_digest
from core.io.threemf import read_placed
from core.io.threemf_model import Key, Placed, Solid
from core.mesh.mesh import Mesh

# Rotations are written in few digits.
_ROUNDING = 1e-5
_DIGITS, _KEY_DIGITS = 6, 4


def read_parts(data: bytes, limits: Limits) -> list[Part]:
    """Return the distinct objects that the build places, each in its own frame, in millimetres.

    An object without a name has that of the nearest object above it. Instances of an object that are scaled,
    stretched or mirrored differently are different parts: a part has the stretch of its instances, without
    their rotation.

    Raises
    ------
    MeshError
        The file is malformed or exceeds the limits; the subclass tells the kind of fault.
    """
    solids, placed, unit = read_placed(data, limits)
    return distinct_parts(_instances(solids, placed, unit), limits)


def _instances(
    solids: dict[Key, Solid], placed: list[Placed], unit: float
) -> Iterator[tuple[tuple[str, bytes, bytes], Callable[[], Part]]]:
    digests = {
        key: mesh_digest(solids[key].vertices, solids[key].faces) for key in {one.key for one in placed}
    }
    for one in placed:
        path = _path(solids, one)
        name = path[-1] if path else ""
        stretch = _stretch(one.matrix[:3, :3])

        def part(
            name: str = name,
            path: tuple[str, ...] = path,
            solid: Solid = solids[one.key],
            stretch: Floats = stretch,
        ) -> Part:
            faces = solid.faces[:, ::-1] if np.linalg.det(stretch) < 0 else solid.faces
            return Part(name, path, 1, Mesh(solid.vertices @ stretch * unit, faces))

        yield (name, digests[one.key], _rounded(stretch, _KEY_DIGITS).tobytes()), part


def _path(solids: dict[Key, Solid], placed: Placed) -> tuple[str, ...]:
    """Return the names from the build item to an instance; objects without a name are left out."""
    names: list[str] = []
    one: Placed | None = placed
    while one is not None and len(names) < PATH_NAMES:
        names.append(solids[one.key].name)
        one = one.above
    return tuple(name for name in reversed(names) if name)


def _stretch(matrix: Floats) -> Floats:
    """Return the symmetric factor S of the polar decomposition A = S R of a transform of rows.

    Parameters
    ----------
    matrix : float64, shape (3, 3)

    Returns
    -------
    stretch : float64, shape (3, 3)
        The identity for a rotation. If A mirrors, -S: R is then a rotation too.
    """
    squares, axes = np.linalg.eigh(matrix @ matrix.T)
    stretch = (axes * np.sqrt(np.maximum(squares, 0.0))) @ axes.T
    if np.abs(stretch - np.eye(3)).max() <= _ROUNDING:
        stretch = np.eye(3)
    return _rounded(-stretch if np.linalg.det(matrix) < 0 else stretch, _DIGITS)


def _rounded(stretch: Floats, digits: int) -> Floats:
    """Return the numbers rounded to so many digits of the largest one."""
    largest = float(np.abs(stretch).max())
    decimals = digits - math.floor(math.log10(largest)) if largest > 0 else 0
    # Without negative zeros, which have other bytes.
    return np.asarray(np.round(stretch, decimals) + 0.0)
