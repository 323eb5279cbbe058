"""`isoshape evaluate`: how well a labelled collection is retrieved, each shape a query against all others."""

import json
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer
from rich import box
from rich.console import Console
from rich.table import Table

from core.embedding import Embedding
from core.evaluation import Evaluation, evaluate
from core.parameters import DEFAULT, PAPER, Parameters
from core.pipeline import Pipeline
from core.similarity import combined_scores
from service.cli.console import fail, output, progress, say
from service.cli.sample import spread
from service.cli.scoring import PairScores, default_workers, embed_files, score_pairs, worker_pool
from service.collections import read_collection

MEASURES = ("nn", "ft", "st", "e", "dcg", "map")


class Ranking(StrEnum):
    """What the others are ranked by."""

    CC = "cc"
    SSD = "ssd"
    SIM = "sim"
    COMBINED = "combined"
    ALL = "all"


@dataclass(frozen=True)
class Report:
    """One evaluation and what it is of."""

    collection: str
    setting: str
    rank_by: str
    figures: Evaluation

    def as_json(self) -> dict[str, object]:
        """The object that `--json` prints."""
        return {
            "collection": self.collection,
            "setting": self.setting,
            "rank_by": self.rank_by,
            "shapes": self.figures.shapes,
            "classes": len(self.figures.classes),
            **{name: getattr(self.figures, name) for name in MEASURES},
            "per_class": {name: asdict(row) for name, row in self.figures.per_class.items()},
        }


def command(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder with labels.csv, or of class folders.")
    ],
    *,
    setting: Annotated[
        Literal["paper", "default"], typer.Option(help="Parameters of the method.")
    ] = "default",
    rank_by: Annotated[
        list[Ranking] | None, typer.Option(help="Ranking; may be given several times. [default: cc]")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one object (a list of them for several rankings).")
    ] = False,
    uncapped: Annotated[
        bool, typer.Option("--uncapped", help="Lift the cap on the number of samples.")
    ] = False,
    limit: Annotated[
        int | None, typer.Option(min=2, help="Evaluate this many shapes only, spread over the classes.")
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, envvar="ISOSHAPE_WORKERS", help="Processes. [default: one a processor]"),
    ] = None,
) -> None:
    """Measure retrieval on a labelled collection; the shape itself is left out of its own ranking.

    NN nearest neighbour, FT and ST first and second tier, E the E-measure of the first 32, DCG discounted
    cumulative gain, MAP mean average precision (Shilane et al. 2004). Ties count against the ranking.
    """
    files = read_collection(folder)
    if limit is not None:
        files = spread(files, limit)
    parameters = PAPER if setting == "paper" else DEFAULT
    if uncapped:
        parameters = replace(parameters, sample_cap=0)
    labels, scores = _score(files, parameters, workers or default_workers())
    reports = [
        Report(folder.resolve().name, setting, ranking.value, _evaluate(scores, labels, ranking))
        for ranking in _rankings(rank_by or [Ranking.CC])
    ]
    if as_json:
        objects = [report.as_json() for report in reports]
        typer.echo(json.dumps(objects[0] if len(objects) == 1 else objects))
    else:
        _print(output(), reports)
    if len(labels) < len(files):
        fail(f"{len(files) - len(labels)} of {len(files)} files could not be used")


def _rankings(chosen: list[Ranking]) -> list[Ranking]:
    if Ranking.ALL in chosen:
        return [ranking for ranking in Ranking if ranking is not Ranking.ALL]
    return list(dict.fromkeys(chosen))


def _score(
    files: list[tuple[Path, str]], parameters: Parameters, workers: int
) -> tuple[list[str], PairScores]:
    """Labels and scores of the files that can be used; each of the others is named."""
    labels: list[str] = []
    embeddings: list[Embedding] = []
    with worker_pool(parameters, workers) as pool, progress() as bar:
        task = bar.add_task("embedding", total=len(files))
        results = embed_files(pool, [path for path, _ in files], lambda n: bar.advance(task, n))
        for (path, label), result in zip(files, results, strict=True):
            if isinstance(result, str):
                say(f"{path}: {result}")
            else:
                labels.append(label)
                embeddings.append(result)
        if not embeddings:
            fail("no file could be used")
        pairs = len(embeddings) * (len(embeddings) - 1) // 2
        scoring = bar.add_task("matching pairs", total=pairs)
        scores = score_pairs(pool, Pipeline(parameters), embeddings, lambda n: bar.advance(scoring, n))
    return labels, scores


def _evaluate(scores: PairScores, labels: list[str], ranking: Ranking) -> Evaluation:
    if ranking is Ranking.COMBINED:
        pairs = ~np.eye(len(labels), dtype=bool)
        matrix = np.zeros(pairs.shape)
        matrix[pairs] = combined_scores(scores.cc[pairs], scores.distances[pairs])
    else:
        matrix = {Ranking.CC: scores.cc, Ranking.SSD: scores.ssd, Ranking.SIM: scores.sim}[ranking]
    return evaluate(matrix, labels, larger_is_closer=ranking is not Ranking.SSD)


def _print(console: Console, reports: list[Report]) -> None:
    first = reports[0]
    overall = Table(
        title=f"{first.collection}, setting {first.setting}: "
        f"{first.figures.shapes} shapes, {len(first.figures.classes)} classes",
        box=box.SIMPLE_HEAD,
        collapse_padding=True,
    )
    overall.add_column("rank by")
    for name in MEASURES:
        overall.add_column(name.upper(), justify="right")
    for report in reports:
        overall.add_row(report.rank_by, *(f"{getattr(report.figures, name):.3f}" for name in MEASURES))
    console.print(overall)
    for report in reports:
        console.print(_class_table(report))


def _class_table(report: Report) -> Table:
    table = Table(title=f"by class, ranked by {report.rank_by}", box=box.SIMPLE_HEAD, collapse_padding=True)
    table.add_column("class")
    for name in ("shapes", "NN", "FT", "ST"):
        table.add_column(name, justify="right")
    table.add_column("most often taken for")
    figures = report.figures
    for name, row in figures.per_class.items():
        taken = figures.confusion[figures.classes.index(name)].copy()
        shapes = int(taken.sum())
        taken[figures.classes.index(name)] = 0
        worst = f"{figures.classes[int(taken.argmax())]} ({int(taken.max())})" if taken.any() else ""
        table.add_row(name, str(shapes), f"{row.nn:.2f}", f"{row.ft:.2f}", f"{row.st:.2f}", worst)
    return table
