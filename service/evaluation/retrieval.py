"""All pairs of a labelled collection scored, with progress on the terminal, and retrieval measures."""

from collections import defaultdict
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TypeVar

from core.arrays import Floats
from core.evaluation.retrieval_measures import Evaluation, evaluate
from core.parameters import DEFAULT, Parameters
from service.console import fail, progress, say
from service.datasets import read_collection
from service.evaluation.baselines import describe_files, distance_matrix, missing_library
from service.evaluation.pairwise_scores import PairScores, embed_files, score_pairs, worker_pool

Result = TypeVar("Result")
Files = list[tuple[Path, str]]
"""Mesh files with their classes."""


class Ranking(StrEnum):
    """The score that shapes are ranked by."""

    CC = "cc"
    SSD = "ssd"
    SIM = "sim"
    COMBINED = "combined"


def collection_files(folder: Path, limit: int | None) -> Files:
    """Return the files of a labelled folder, or at most `limit` of them, spread over the classes.

    Raises
    ------
    DatasetError
        The folder is no labelled collection.
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
    ordered = _in_turn([by_class[name] for name in chosen]) + _in_turn([by_class[name] for name in others])
    kept = set(ordered[:count])
    return [file for file in files if file in kept]


def _in_turn(lists: list[Files]) -> Files:
    depth = max(map(len, lists), default=0)
    return [members[i] for i in range(depth) for members in lists if i < len(members)]


def score_collection(
    files: Sequence[tuple[Path, str]], parameters: Parameters, workers: int
) -> tuple[list[str], PairScores]:
    """Return labels and scores of the readable files; the others are reported on standard error."""
    with worker_pool(parameters, workers) as pool, progress() as bar:
        task = bar.add_task("embedding", total=len(files))
        results = embed_files(pool, [path for path, _ in files], lambda n: bar.advance(task, n))
        labels, embeddings = usable(files, results)
        pairs = len(embeddings) * (len(embeddings) - 1) // 2
        scoring = bar.add_task("matching pairs", total=pairs)
        scores = score_pairs(pool, embeddings, lambda n: bar.advance(scoring, n))
    return labels, scores


def score_baseline(files: Sequence[tuple[Path, str]], method: str, workers: int) -> tuple[list[str], Floats]:
    """Return labels of the files that a baseline can use, and its distances between them, shape (n, n)."""
    require(method)
    with worker_pool(DEFAULT, workers) as pool, progress() as bar:
        task = bar.add_task(f"{method}: describing", total=len(files))
        results = describe_files(pool, method, [path for path, _ in files], lambda n: bar.advance(task, n))
        labels, descriptions = usable(files, results)
        pairs = len(descriptions) * (len(descriptions) - 1) // 2
        comparing = bar.add_task(f"{method}: comparing pairs", total=pairs)
        distances = distance_matrix(pool, method, descriptions, lambda n: bar.advance(comparing, n))
    return labels, distances


def require(method: str) -> None:
    """End the command if the library of a baseline is not installed."""
    library = missing_library(method)
    if library is not None:
        fail(f"{method} needs {library}, which is not installed: pip install isoshape[peers]", status=2)


def usable(
    files: Sequence[tuple[Path, str]], results: Sequence[Result | str]
) -> tuple[list[str], list[Result]]:
    """Return labels and results of the files that have a result; print the errors of the others.

    The command ends if no file has a result.
    """
    labels: list[str] = []
    kept: list[Result] = []
    for (path, label), result in zip(files, results, strict=True):
        if isinstance(result, str):
            say(f"{path}: {result}")
        else:
            labels.append(label)
            kept.append(result)
    if not kept:
        fail("no file could be used")
    return labels, kept


def evaluate_ranking(scores: PairScores, labels: Sequence[str], ranking: Ranking) -> Evaluation:
    """Return the evaluation of a ranking by one of the scores."""
    return evaluate(ranked(scores, ranking), labels, larger_is_closer=ranking is not Ranking.SSD)


def ranked(scores: PairScores, ranking: Ranking) -> Floats:
    """Return the scores of a ranking, shape (n, n): distances for SSD, otherwise similarities."""
    matrix: Floats = getattr(scores, ranking.value)
    return matrix
