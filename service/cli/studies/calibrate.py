"""`isoshape calibrate`: the parameters of `combined`, fitted to labelled collections and judged on them."""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from core.errors import ParameterError
from core.evaluation.calibration import LabelledPairs
from core.parameters import DEFAULT
from core.ranking.opinion_pool import features, offset, part_features
from service.cli.options import Workers
from service.console import fail, output, progress, say
from service.datasets import read_collection
from service.studies.calibration.page import COLUMNS, constants, page, summary
from service.studies.calibration.part_pairs import LEVELS, part_pairs
from service.studies.calibration.study import CalibrationStudy, CollectionPairs, study
from service.studies.pairwise_scores import PairScores, default_workers, worker_pool
from service.studies.retrieval import score_collection
from service.studies.robustness.perturbed_queries import clean_gallery
from service.studies.subset import spread

PARTS = 48
"""Each of them is made incomplete in several ways, and each result is a query."""


def calibrate_command(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="Folders of meshes with labels.csv, or with a folder a class."),
    ],
    *,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write calibration.md and its pictures to this folder.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    limit: Annotated[
        int | None,
        typer.Option(min=4, help="Use only this many shapes of each folder, spread over the classes."),
    ] = None,
    parts: Annotated[
        int, typer.Option(min=2, help="This many shapes of each folder are made incomplete.")
    ] = PARTS,
    workers: Workers = None,
) -> None:
    """Fit the class probability to labelled collections.

    The command prints the constants of core/ranking/opinion_pool.py: the coefficients of a logistic
    regression over all pairs of complete shapes, each collection with the same weight, and of another over
    pairs with an incomplete shape, also of shapes with holes made in them or with a part cut away. Each class
    is judged by models fitted without that class. Three classes or more are needed.
    """
    names, whole, chosen, sampled = [], [], [], []
    short = 0
    for folder in folders:
        files = read_collection(folder)
        if limit is not None:
            files = spread(files, limit)
        sampled.append(spread(files, min(parts, len(files))))
        chosen.append(files)
    _check([[label for _, label in files] for files in chosen], "")
    _check([[label for _, label in files] for files in sampled], " by --parts")
    for folder, files in zip(folders, chosen, strict=True):
        labels, scores = score_collection(files, DEFAULT, workers or default_workers())
        short += len(files) - len(labels)
        names.append(folder.resolve().name)
        whole.append((labels, scores))
    _check([labels for labels, _ in whole], "")
    perturbed = [_perturbed(files, workers or default_workers()) for files in sampled]
    try:
        found = study(names, [_pairs(*one, pairs) for one, pairs in zip(whole, perturbed, strict=True)])
    except ParameterError as error:
        fail(str(error))
    if out is not None:
        _write(out, found, f"isoshape calibrate {' '.join(names)} --out docs{_limited(limit, parts)}")
    if as_json:
        typer.echo(json.dumps(found.as_json()))
    else:
        _print(found)
    if short:
        fail(f"{short} files could not be used")


def _pairs(labels: Sequence[str], scores: PairScores, perturbed: Sequence[LabelledPairs]) -> CollectionPairs:
    differences = scores.differences
    assert differences is not None, "the default setting has views"
    return CollectionPairs(
        LabelledPairs(tuple(labels), features(differences), ~differences.part, offset(differences)),
        LabelledPairs(tuple(labels), part_features(differences), differences.part),
        perturbed,
    )


def _perturbed(files: list[tuple[Path, str]], workers: int) -> list[LabelledPairs]:
    with worker_pool(DEFAULT, workers) as pool, progress() as bar:
        task = bar.add_task("embedding", total=len(files))
        gallery = clean_gallery(pool, files, lambda _: None, lambda n: bar.advance(task, n))
        task = bar.add_task("incomplete queries", total=len(gallery.files) * len(LEVELS))
        return part_pairs(pool, gallery, say, lambda n: bar.advance(task, n))


def _check(labels: Sequence[Sequence[str]], where: str) -> None:
    """End the command unless every model has pairs of one class and pairs of two classes."""
    sizes = Counter(label.casefold() for several in labels for label in several)
    if len(sizes) < 3 or sum(size > 1 for size in sizes.values()) < 2:
        fail(f"three classes or more are needed{where}, two of them with two shapes or more")


def _limited(limit: int | None, parts: int) -> str:
    limited = f" --limit {limit}" if limit is not None else ""
    return limited + (f" --parts {parts}" if parts != PARTS else "")


def _print(found: CalibrationStudy) -> None:
    table = Table(
        title="each class judged by a model fitted without it", box=box.SIMPLE_HEAD, collapse_padding=True
    )
    for i, column in enumerate(COLUMNS):
        table.add_column(column, justify="right" if i else "left", overflow="fold")
    for row in summary(found):
        table.add_row(*row)
    output().print(table)
    typer.echo(constants(found))


def _write(folder: Path, found: CalibrationStudy, made_by: str) -> None:
    # Here, because matplotlib takes a second to import and only this option draws.
    from service.studies.calibration.figure import reliability_figure  # noqa: PLC0415

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "calibration.png").write_bytes(reliability_figure(found))
    (folder / "calibration.md").write_text(page(found, made_by), encoding="utf-8")
