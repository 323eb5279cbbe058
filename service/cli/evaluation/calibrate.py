"""`isoshape calibrate`: the parameters of `combined`, fitted to labelled collections and judged on them."""

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated

import typer

from core.errors import ParameterError
from core.parameters import DEFAULT
from service.cli.evaluation.options import AsJson, Workers
from service.console import count_of, fail, print_table
from service.evaluation.calibration import constants, part_pairs, study, summary
from service.evaluation.retrieval import collection_files, labels_of, score_collection, spread

PARTS = 48
"""Each of them is made incomplete in several ways, and each result is a query."""


def calibrate_command(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="Folders of meshes with labels.csv, or with a folder a class."),
    ],
    *,
    as_json: AsJson = False,
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

    The command prints the constants of core/ranking/class_probability.py: the coefficients of a logistic
    regression over all pairs of complete shapes, each collection with the same weight, and of another over
    pairs with an incomplete shape, also of shapes with holes made in them or with a part cut away. Each class
    is judged by models fitted without that class: the table has the expected calibration error, and the
    retrieval by these probabilities. Three classes or more are needed.
    """
    chosen = [collection_files(folder, limit) for folder in folders]
    sampled = [spread(files, min(parts, len(files))) for files in chosen]
    _check(map(labels_of, chosen), "")
    _check(map(labels_of, sampled), " by --parts")
    scored = [score_collection(files, DEFAULT, workers) for files in chosen]
    _check((labels for labels, _ in scored), "")
    names = [folder.resolve().name for folder in folders]
    perturbed = [level for files in sampled for level in part_pairs(files, workers)]
    try:
        judged = study(names, scored, perturbed)
    except ParameterError as error:
        fail(str(error))
    if as_json:
        typer.echo(json.dumps(judged))
    else:
        print_table("each class judged by a model fitted without it", *summary(judged))
        typer.echo(constants(judged))
    unusable = sum(map(len, chosen)) - sum(len(labels) for labels, _ in scored)
    if unusable:
        fail(f"{count_of(unusable, 'file')} could not be used")


def _check(labels: Iterable[Sequence[str]], where: str) -> None:
    """End the command unless every model has pairs of one class and pairs of two classes."""
    sizes = Counter(label.casefold() for collection in labels for label in collection)
    if len(sizes) < 3 or sum(size > 1 for size in sizes.values()) < 2:
        fail(f"three classes or more are needed{where}, two of them with two shapes or more")
