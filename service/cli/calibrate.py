"""`isoshape calibrate`: the parameters of `combined`, fitted to labelled collections and judged on them."""

import json
from collections import Counter
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich import box
from rich.table import Table

from core.calibration import Collection
from core.mesh import Floats
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from service.calibration.page import COLUMNS, constants, page, summary
from service.calibration.study import Study, study
from service.cli.console import fail, output
from service.cli.options import Workers
from service.cli.retrieval import score_collection
from service.cli.sample import spread
from service.cli.scoring import PairScores, default_workers
from service.collections import read_collection


def command(
    folders: Annotated[
        list[Path], typer.Argument(metavar="DIR...", help="Folders with labels.csv, or of class folders.")
    ],
    *,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write calibration.md and its picture there.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one object.")] = False,
    limit: Annotated[
        int | None, typer.Option(min=4, help="So many shapes of each folder only, spread over the classes.")
    ] = None,
    workers: Workers = None,
) -> None:
    """Fit the chance that two shapes are of one class, and print the constants for core/combination.py.

    A logistic regression over all pairs, each collection with the same weight. It is judged by class: the
    pairs of a class' shapes by a model fitted without that class. Three classes or more are needed.
    """
    names, collections = [], []
    short = 0
    for folder in folders:
        files = read_collection(folder)
        if limit is not None:
            files = spread(files, limit)
        labels, scores = score_collection(files, DEFAULT, workers or default_workers())
        short += len(files) - len(labels)
        names.append(folder.resolve().name)
        collections.append(Collection(tuple(labels), _evidence(scores)))
    _check(collections)
    found = study(names, collections)
    if out is not None:
        _write(out, found, f"isoshape calibrate {' '.join(names)} --out docs{_limited(limit)}")
    if as_json:
        typer.echo(json.dumps(found.as_json()))
    else:
        _print(found)
    if short:
        fail(f"{short} files could not be used")


def _evidence(scores: PairScores) -> Floats:
    pipeline = Pipeline(DEFAULT)
    rows = zip(scores.cc, scores.sim, scores.signatures, strict=True)
    return np.stack([pipeline.evidence(cc, sim, own, scores.signatures) for cc, sim, own in rows])


def _check(collections: list[Collection]) -> None:
    """End the command where, without some class, no pair would be of one class or none of two."""
    sizes = Counter(str(code) for collection in collections for code in collection.codes)
    if len(sizes) < 3 or sum(size > 1 for size in sizes.values()) < 2:
        fail("three classes or more are needed, two of them with two shapes or more")


def _limited(limit: int | None) -> str:
    return f" --limit {limit}" if limit is not None else ""


def _print(found: Study) -> None:
    table = Table(title="judged without the class in question", box=box.SIMPLE_HEAD, collapse_padding=True)
    for i, column in enumerate(COLUMNS):
        table.add_column(column, justify="right" if i else "left", overflow="fold")
    for row in summary(found):
        table.add_row(*row)
    output().print(table)
    typer.echo(constants(found.model))


def _write(folder: Path, found: Study, made_by: str) -> None:
    # Here, since no other use of the command draws, and the drawing library takes a second to load.
    from service.calibration.figure import reliability_figure  # noqa: PLC0415

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "calibration.png").write_bytes(reliability_figure(found))
    (folder / "calibration.md").write_text(page(found, made_by), encoding="utf-8")
