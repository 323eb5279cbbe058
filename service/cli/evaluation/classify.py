"""`isoshape classify`: Algorithm 3, the class of each shape by its nearest neighbour, or none."""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from core.evaluation.classification import Classification, classify
from core.parameters import DEFAULT
from service.cli.evaluation.options import AsJson, Collection, Workers
from service.console import fail, print_table
from service.evaluation.pairwise_scores import default_workers
from service.evaluation.retrieval import Ranking, collection_files, score_collection


def classify_command(
    folder: Collection,
    *,
    rank_by: Annotated[Ranking, typer.Option(help="Score that ranks the neighbours.")] = Ranking.CC,
    as_json: AsJson = False,
    limit: Annotated[
        int | None, typer.Option(min=6, help="Use only this many shapes, spread over the classes.")
    ] = None,
    workers: Workers = None,
) -> None:
    """Classify each shape by its nearest neighbour.

    A shape whose nearest neighbour scores below the threshold stays unmatched (Algorithm 3 of the paper). The
    threshold best separates the nearest neighbours found with the shape's class present from those found
    without it (largest balanced accuracy). Each class is judged by the threshold of the other classes.
    """
    files = collection_files(folder, limit)
    classes = {str(path): label for path, label in files}
    # The path takes the place of the class: the result names the usable files by it.
    named = [(path, str(path)) for path, _ in files]
    names, scores = score_collection(named, DEFAULT, workers or default_workers())
    labels = [classes[name] for name in names]
    result = classify(getattr(scores, rank_by), labels, larger_is_closer=rank_by is not Ranking.SSD)
    if as_json:
        typer.echo(json.dumps(_object(folder, rank_by, names, labels, result)))
    else:
        side = "above" if rank_by is Ranking.SSD else "below"
        print_table(
            f"{folder.resolve().name}: first neighbours by {rank_by.value}, "
            f"unmatched {side} {result.threshold:.4f}",
            ("shape", "class", "first neighbour", "class found", rank_by.value),
            _shapes(names, labels, result),
            left=4,
        )
        print_table(
            f"by class; balanced accuracy of matched and unmatched {result.balanced_accuracy:.3f}",
            ("class", "most often taken for", "shapes", "right", "wrong", "unmatched"),
            _by_class(labels, result),
            left=2,
            last=1,
        )
    if len(names) < len(files):
        fail(f"{len(files) - len(names)} of {len(files)} files could not be used")


def _object(
    folder: Path, rank_by: Ranking, names: list[str], labels: list[str], result: Classification
) -> dict[str, object]:
    return {
        "collection": folder.resolve().name,
        "rank_by": rank_by.value,
        "threshold": result.threshold,
        "balanced_accuracy": result.balanced_accuracy,
        **_counts(result, range(len(names))),
        "shapes": [
            {
                "file": name,
                "class": label,
                "neighbour": names[result.neighbour[i]],
                "score": float(result.score[i]),
                "found": labels[result.neighbour[i]] if result.matched[i] else None,
            }
            for i, (name, label) in enumerate(zip(names, labels, strict=True))
        ],
    }


def _counts(result: Classification, members: Sequence[int]) -> dict[str, int]:
    return {
        "right": sum(bool(result.matched[i] and result.right[i]) for i in members),
        "wrong": sum(bool(result.matched[i] and not result.right[i]) for i in members),
        "unmatched": sum(not result.matched[i] for i in members),
    }


def _shapes(names: list[str], labels: list[str], result: Classification) -> list[list[str]]:
    return [
        [
            Path(name).name,
            label,
            Path(names[neighbour]).name,
            labels[neighbour] if matched else "unmatched",
            f"{score:.4f}",
        ]
        for name, label, neighbour, matched, score in zip(
            names, labels, result.neighbour, result.matched, result.score, strict=True
        )
    ]


def _by_class(labels: list[str], result: Classification) -> list[list[str]]:
    """Return a row for each class, and one for all classes."""
    rows = []
    for label in sorted(set(labels)):
        members = [i for i, other in enumerate(labels) if other == label]
        wrong = Counter(
            labels[result.neighbour[i]] for i in members if result.matched[i] and not result.right[i]
        )
        taken = max(sorted(wrong), key=lambda name: wrong[name]) if wrong else ""
        confused = f"{taken} ({wrong[taken]})" if taken else ""
        rows.append([label, confused, str(len(members)), *map(str, _counts(result, members).values())])
    everything = range(len(labels))
    rows.append(["all", "", str(len(labels)), *map(str, _counts(result, everything).values())])
    return rows
