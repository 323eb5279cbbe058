"""All pairs of a labelled collection scored, with progress on the terminal, and retrieval measures."""

from collections import defaultdict
from collections.abc import Sequence
from importlib.util import find_spec
from itertools import zip_longest
from math import comb
from pathlib import Path
from typing import TypeVar

from core.arrays import Floats
from core.evaluation.retrieval_measures import Evaluation, evaluate
from core.parameters import DEFAULT, Parameters
from service.console import counted, fail, progress, say
from service.datasets import read_collection
from service.evaluation.baselines import BASELINES, describe_files, distance_matrix
from service.evaluation.pairwise_scores import PairScores, embed_files, score_pairs, worker_pool
from service.search.schemas import RankBy

Result = TypeVar("Result")
Files = list[tuple[Path, str]]
"""Mesh files with their classes."""


def collection_files(folder: Path, limit: int | None) -> Files:
    """Return the files of a labelled folder, or at most `limit` of them, spread over the classes.

    Raise DatasetError if the folder is no labelled collection.
    """
    files = read_collection(folder)
    return files if limit is None else spread(files, limit)


def spread(files: Files, count: int) -> Files:
    """Return a subset over as many classes as can have two files each, in the collection's order.

    The classes are evenly spaced among those with two files or more, by name; each gives its files in
    turn, the first of every class before the second of any. The other classes are drawn on when these have
    no more.
    """
    by_class: dict[str, Files] = defaultdict(list)
    for file in files:
        by_class[file[1]].append(file)
    large = sorted(name for name, members in by_class.items() if len(members) > 1)
    wanted = min(len(large), max(1, count // 2))
    chosen = [large[i * len(large) // wanted] for i in range(wanted)]
    others = sorted(set(by_class) - set(chosen))
    turns = (turn for names in (chosen, others) for turn in zip_longest(*(by_class[name] for name in names)))
    ordered = [file for turn in turns for file in turn if file is not None]
    kept = set(ordered[:count])
    return [file for file in files if file in kept]


def score_collection(
    files: Files, parameters: Parameters, workers: int | None
) -> tuple[list[str], PairScores]:
    """Return labels and scores of the readable files; the others are reported on standard error."""
    paths = [path for path, _ in files]
    with worker_pool(parameters, workers) as pool, progress() as bar:
        files, embeddings = usable(files, embed_files(pool, paths, counted(bar, "embedding", len(paths))))
        pairs = comb(len(embeddings), 2)
        return labels_of(files), score_pairs(pool, embeddings, counted(bar, "matching pairs", pairs))


def score_baseline(files: Files, method: str, workers: int | None) -> tuple[list[str], Floats]:
    """Return labels of the files that a baseline can use, and its distances between them, shape (n, n)."""
    require(method)
    paths = [path for path, _ in files]
    with worker_pool(DEFAULT, workers) as pool, progress() as bar:
        done = counted(bar, f"{method}: describing", len(paths))
        files, descriptions = usable(files, describe_files(pool, method, paths, done))
        done = counted(bar, f"{method}: comparing pairs", comb(len(descriptions), 2))
        return labels_of(files), distance_matrix(pool, method, descriptions, done)


def require(method: str) -> None:
    """End the command if the library of a baseline is not installed."""
    library = BASELINES[method].library
    if library is not None and find_spec(library) is None:
        fail(f"{method} needs {library}, which is not installed: pip install isoshape[peers]", status=2)


def usable(files: Files, results: Sequence[Result | str]) -> tuple[Files, list[Result]]:
    """Return the files that have a result, and these; print the errors of the others.

    The command ends if no file has a result.
    """
    kept: list[tuple[tuple[Path, str], Result]] = []
    for file, result in zip(files, results, strict=True):
        if isinstance(result, str):
            say(f"{file[0]}: {result}")
        else:
            kept.append((file, result))
    if not kept:
        fail("no file could be used")
    return [file for file, _ in kept], [result for _, result in kept]


def labels_of(files: Files) -> list[str]:
    """Return the class of each file."""
    return [label for _, label in files]


def evaluate_ranking(scores: PairScores, labels: Sequence[str], ranking: RankBy) -> Evaluation:
    """Return the evaluation of a ranking by one of the scores; all but SSD grow with similarity."""
    return evaluate(getattr(scores, ranking), labels, larger_is_closer=ranking != "ssd")
