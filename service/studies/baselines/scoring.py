"""All pairs of a collection scored by a baseline, in a pool of processes."""

import pickle
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from functools import cache, lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from core.errors import CoreError
from core.io import format_of, read_mesh
from service.studies.baselines.methods import Baseline, BaselineName, Description, load

Floats = NDArray[np.float64]


def describe_files(
    pool: Executor, method: BaselineName, paths: Sequence[Path], done: Callable[[int], None]
) -> list[Description | str]:
    """The description of each file, or the reason why there is none; `done` receives the number finished."""
    results: list[Description | str] = []
    for result in pool.map(partial(_describe, method), paths):
        results.append(result)
        done(1)
    return results


def distance_matrix(
    pool: Executor, method: BaselineName, descriptions: Sequence[Description], done: Callable[[int], None]
) -> Floats:
    """Distances of all pairs, shape (n, n); each pair is compared once."""
    n = len(descriptions)
    distances = np.zeros((n, n))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "descriptions"
        path.write_bytes(pickle.dumps(list(descriptions)))
        for i, row in enumerate(pool.map(partial(_compare, method, path), range(n - 1))):
            distances[i, i + 1 :] = distances[i + 1 :, i] = row
            done(n - 1 - i)
    return distances


def _describe(method: BaselineName, path: Path) -> Description | str:
    try:
        return _baseline(method).describe(read_mesh(path.read_bytes(), format_of(path.name)))
    except CoreError as error:
        return f"{error.kind}: {error}"
    except OSError as error:
        return error.strerror or str(error)
    except Exception as error:
        # An error of the library is reported for this file; the study continues.
        return f"{type(error).__name__}: {error}"


def _compare(method: BaselineName, path: Path, i: int) -> Floats:
    descriptions = _load(path)
    return _baseline(method).compare(descriptions[i], descriptions[i + 1 :])


@cache
def _baseline(method: BaselineName) -> Baseline:
    return load(method)


@lru_cache(maxsize=1)
def _load(path: Path) -> list[Description]:
    descriptions: list[Description] = pickle.loads(path.read_bytes())
    return descriptions
