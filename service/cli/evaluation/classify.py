"""`isoshape classify`: Algorithm 3, the class of each shape by its nearest neighbour, or none."""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from core.evaluation.classification import Classification, classify
from core.parameters import DEFAULT
from service.cli.evaluation.options import AsJson, Collection, Workers
from service.console import fail, print_table
from service.evaluation.retrieval import collection_files, score_collection
from service.search.schemas import RankBy


def classify_command(
    folder: Collection,
    *,
    rank_by: Annotated[RankBy, typer.Option(help="Score that ranks the neighbours.")] = "cc",
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
    names, scores = score_collection(named, DEFAULT, workers)
    labels = [classes[name] for name in names]
    result = classify(getattr(scores, rank_by), labels, larger_is_closer=rank_by != "ssd")
    shapes: list[dict[str, Any]] = [
        {
            "file": name,
            "class": label,
            "neighbour": names[neighbour],
            "score": float(score),
            "found": labels[neighbour] if matched else None,
        }
        for name, label, neighbour, score, matched in zip(
            names, labels, result.neighbour, result.score, result.matched, strict=True
        )
    ]
    about = {"collection": folder.resolve().name, "rank_by": rank_by}
    if as_json:
        numbers = {"threshold": result.threshold, "balanced_accuracy": result.balanced_accuracy}
        counts = _counts(result, range(len(names)))
        typer.echo(json.dumps({**about, **numbers, **counts, "shapes": shapes}))
    else:
        side = "above" if rank_by == "ssd" else "below"
        rows = [
            [
                Path(shape["file"]).name,
                shape["class"],
                Path(shape["neighbour"]).name,
                shape["found"] or "unmatched",
                f"{shape['score']:.4f}",
            ]
            for shape in shapes
        ]
        print_table(
            f"{about['collection']}: first neighbours by {rank_by}, unmatched {side} {result.threshold:.4f}",
            ("shape", "class", "first neighbour", "class found", rank_by),
            rows,
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


def _counts(result: Classification, members: Sequence[int]) -> dict[str, int]:
    return {
        "right": sum(bool(result.matched[i] and result.right[i]) for i in members),
        "wrong": sum(bool(result.matched[i] and not result.right[i]) for i in members),
        "unmatched": sum(not result.matched[i] for i in members),
    }


def _by_class(labels: list[str], result: Classification) -> list[list[str]]:
    """Return a row for each class, and one for all classes."""
    rows = []
    for label in (*sorted(set(labels)), None):
        members = [i for i, each in enumerate(labels) if label in {each, None}]
        wrong = Counter(
            labels[result.neighbour[i]] for i in members if result.matched[i] and not result.right[i]
        )
        taken = "{} ({})".format(*min(wrong.items(), key=lambda item: (-item[1], item[0]))) if wrong else ""
        names = ["all", ""] if label is None else [label, taken]
        rows.append([*names, str(len(members)), *map(str, _counts(result, members).values())])
    return rows
