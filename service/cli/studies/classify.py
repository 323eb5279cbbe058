"""`isoshape classify`: Algorithm 3, the class of each shape by its nearest neighbour, or none."""

import json
from collections import Counter
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from core.evaluation.classification import Classification, classify
from core.io import format_of, read_mesh
from core.parameters import DEFAULT
from service.cli.options import Workers
from service.console import fail, output
from service.datasets import read_collection
from service.studies.pairwise_scores import default_workers
from service.studies.retrieval import Ranking, ranked, score_collection
from service.studies.subset import spread


def classify_command(
    folder: Annotated[
        Path,
        typer.Argument(metavar="DIR", help="Folder of meshes with labels.csv, or with a folder a class."),
    ],
    *,
    rank_by: Annotated[Ranking, typer.Option(help="Score that ranks the neighbours.")] = Ranking.CC,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a PNG of thumbnails by class, the unmatched ones in grey."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
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
    files = read_collection(folder)
    if limit is not None:
        files = spread(files, limit)
    classes = {str(path): label for path, label in files}
    # The path takes the place of the class: the result names the usable files by it.
    named = [(path, str(path)) for path, _ in files]
    names, scores = score_collection(named, DEFAULT, workers or default_workers())
    labels = [classes[name] for name in names]
    found = classify(ranked(scores, rank_by), labels, larger_is_closer=rank_by is not Ranking.SSD)
    if as_json:
        typer.echo(json.dumps(_object(folder, rank_by, names, labels, found)))
    else:
        output().print(_shapes(folder, rank_by, names, labels, found))
        output().print(_summary(labels, found))
    if picture is not None:
        # Here, because matplotlib takes a second to import and only this option draws.
        from service.studies.figures.classes import classes_picture  # noqa: PLC0415

        meshes = [read_mesh(Path(name).read_bytes(), format_of(name)) for name in names]
        picture.parent.mkdir(parents=True, exist_ok=True)
        picture.write_bytes(classes_picture(meshes, labels, found))
    if len(names) < len(files):
        fail(f"{len(files) - len(names)} of {len(files)} files could not be used")


def _object(
    folder: Path, rank_by: Ranking, names: list[str], labels: list[str], found: Classification
) -> dict[str, object]:
    return {
        "collection": folder.resolve().name,
        "rank_by": rank_by.value,
        "threshold": found.threshold,
        "balanced_accuracy": found.balanced_accuracy,
        **_counts(found, range(len(names))),
        "shapes": [
            {
                "file": name,
                "class": label,
                "neighbour": names[found.neighbour[i]],
                "score": float(found.score[i]),
                "found": labels[found.neighbour[i]] if found.matched[i] else None,
            }
            for i, (name, label) in enumerate(zip(names, labels, strict=True))
        ],
    }


def _counts(found: Classification, members: range | list[int]) -> dict[str, int]:
    return {
        "right": sum(bool(found.matched[i] and found.right[i]) for i in members),
        "wrong": sum(bool(found.matched[i] and not found.right[i]) for i in members),
        "unmatched": sum(not found.matched[i] for i in members),
    }


def _shapes(
    folder: Path, rank_by: Ranking, names: list[str], labels: list[str], found: Classification
) -> Table:
    table = Table(
        title=f"{folder.resolve().name}: first neighbours by {rank_by.value}, "
        f"unmatched {'above' if rank_by is Ranking.SSD else 'below'} {found.threshold:.4f}",
        box=box.SIMPLE_HEAD,
        collapse_padding=True,
    )
    for name in ("shape", "class", "first neighbour"):
        table.add_column(name, overflow="fold")
    table.add_column(rank_by.value, justify="right")
    table.add_column("class found")
    for i, (name, label) in enumerate(zip(names, labels, strict=True)):
        other = int(found.neighbour[i])
        table.add_row(
            Path(name).name,
            label,
            Path(names[other]).name,
            f"{found.score[i]:.4f}",
            labels[other] if found.matched[i] else "unmatched",
        )
    return table


def _summary(labels: list[str], found: Classification) -> Table:
    table = Table(
        title=f"by class; balanced accuracy of matched and unmatched {found.balanced_accuracy:.3f}",
        box=box.SIMPLE_HEAD,
        collapse_padding=True,
    )
    table.add_column("class")
    for name in ("shapes", "right", "wrong", "unmatched"):
        table.add_column(name, justify="right")
    table.add_column("most often taken for")
    for label in sorted(set(labels)):
        members = [i for i, other in enumerate(labels) if other == label]
        missed = [i for i in members if found.matched[i] and not found.right[i]]
        wrong = Counter(labels[found.neighbour[i]] for i in missed)
        taken = max(sorted(wrong), key=lambda name: wrong[name]) if wrong else ""
        counts = [str(count) for count in _counts(found, members).values()]
        table.add_row(label, str(len(members)), *counts, f"{taken} ({wrong[taken]})" if taken else "")
    table.add_section()
    counts = [str(count) for count in _counts(found, range(len(labels))).values()]
    table.add_row("all", str(len(labels)), *counts, "")
    return table
