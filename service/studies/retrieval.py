"""All pairs of a labelled collection scored, with progress on the terminal, and retrieval measures."""

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from core.evaluation.retrieval_measures import Evaluation, evaluate
from core.parameters import DEFAULT, Parameters
from core.pipeline import Pipeline
from service.console import fail, progress, say
from service.studies.baselines.methods import BaselineName, MissingPeerError, load
from service.studies.baselines.scoring import describe_files, distance_matrix
from service.studies.pairwise_scores import PairScores, embed_files, score_pairs, worker_pool

Result = TypeVar("Result")


class Ranking(StrEnum):
    """The score that shapes are ranked by."""

    CC = "cc"
    SSD = "ssd"
    SIM = "sim"
    COMBINED = "combined"


def score_collection(
    files: Sequence[tuple[Path, str]], parameters: Parameters, workers: int
) -> tuple[list[str], PairScores]:
    """Labels and scores of the readable files; the others are reported on standard error."""
    with worker_pool(parameters, workers) as pool, progress() as bar:
        task = bar.add_task("embedding", total=len(files))
        found = embed_files(pool, [path for path, _ in files], lambda n: bar.advance(task, n))
        labels, embeddings = usable(files, found)
        pairs = len(embeddings) * (len(embeddings) - 1) // 2
        scoring = bar.add_task("matching pairs", total=pairs)
        scores = score_pairs(pool, Pipeline(parameters), embeddings, lambda n: bar.advance(scoring, n))
    return labels, scores


def score_baseline(
    files: Sequence[tuple[Path, str]], method: BaselineName, workers: int
) -> tuple[list[str], NDArray[np.float64]]:
    """Labels of the files that a baseline can use, and its distances between them, shape (n, n)."""
    ready(method)
    with worker_pool(DEFAULT, workers) as pool, progress() as bar:
        task = bar.add_task(f"{method}: describing", total=len(files))
        found = describe_files(pool, method, [path for path, _ in files], lambda n: bar.advance(task, n))
        labels, describe = usable(files, found)
        pairs = len(describe) * (len(describe) - 1) // 2
        comparing = bar.add_task(f"{method}: comparing pairs", total=pairs)
        distances = distance_matrix(pool, method, describe, lambda n: bar.advance(comparing, n))
    return labels, distances


def ready(method: BaselineName) -> None:
    """End the command if the library of the method is not installed."""
    try:
        load(method)
    except MissingPeerError as error:
        fail(str(error), status=2)


def usable(
    files: Sequence[tuple[Path, str]], results: Sequence[Result | str]
) -> tuple[list[str], list[Result]]:
    """Labels and results of the files that have a result; the errors of the other files are printed.

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
    """The evaluation of a ranking by one of the scores."""
    return evaluate(ranked(scores, ranking), labels, larger_is_closer=ranking is not Ranking.SSD)


def ranked(scores: PairScores, ranking: Ranking) -> NDArray[np.float64]:
    """The scores of a ranking, shape (n, n): distances for SSD, otherwise similarities."""
    return {
        Ranking.CC: scores.cc,
        Ranking.SSD: scores.ssd,
        Ranking.SIM: scores.sim,
        Ranking.COMBINED: scores.combined,
    }[ranking]
