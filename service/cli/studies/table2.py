"""`isoshape table2`: the paper's Table 2 beside the accuracies measured here, category by category."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer

from core.evaluation.retrieval_measures import Evaluation, evaluate
from core.parameters import DEFAULT, PAPER
from core.studies.published_figures import ALL_CATEGORIES, METHODS, TABLE_2, Category
from service.cli.options import Workers
from service.console import fail, say
from service.datasets import read_collection
from service.studies.baselines.methods import BaselineName
from service.studies.pairwise_scores import default_workers
from service.studies.retrieval import Ranking, evaluate_ranking, ready, score_baseline, score_collection
from service.studies.subset import spread

BASELINES = (BaselineName.SHAPEDNA, BaselineName.ICP, BaselineName.MDS)
TITLES = {"cc": "cc", "combined": "combined", "shapedna": "ShapeDNA", "icp": "ICP", "mds": "MDS"}


@dataclass(frozen=True)
class Line:
    """A class: its category in the paper, if any, and the accuracies measured here by method, in per cent."""

    label: str
    category: Category | None
    here: Mapping[str, float]

    def as_json(self) -> dict[str, object]:
        """Return the object that `--json` prints."""
        return {
            "class": self.label,
            "category": self.category.title if self.category else None,
            "paper": dict(self.category.accuracy) if self.category else None,
            "here": dict(self.here),
        }


def table2_command(
    folder: Annotated[
        Path,
        typer.Argument(metavar="DIR", help="Folder of meshes with labels.csv, or with a folder a class."),
    ],
    *,
    setting: Annotated[
        Literal["paper", "default"], typer.Option(help="Parameters of the method.")
    ] = "default",
    baselines: Annotated[
        bool, typer.Option("--baselines/--no-baselines", help="Measure ShapeDNA, ICP and MDS too.")
    ] = True,
    rivals: Annotated[
        bool | None, typer.Option("--rivals/--no-rivals", hidden=True, help="Deprecated: use --baselines.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    limit: Annotated[
        int | None, typer.Option(min=2, help="Use only this many shapes, spread over the classes.")
    ] = None,
    workers: Workers = None,
) -> None:
    """Measure the paper's Table 2, category by category.

    The accuracy of a class is the share of its shapes whose nearest neighbour is of the same class. Classes
    and the paper's categories are matched by the names of the Princeton Segmentation Benchmark (Human,
    Fourleg, Airplane, Bird, Fish, Cup). Of the paper's baselines, libraries provide ICP and MDS, but neither
    Parts nor TPS-RPM.
    """
    if rivals is not None:
        say("--rivals and --no-rivals are deprecated: use --baselines and --no-baselines")
        baselines = rivals
    files = read_collection(folder)
    if limit is not None:
        files = spread(files, limit)
    methods = BASELINES if baselines else ()
    for method in methods:
        ready(method)
    labels, scores = score_collection(
        files, PAPER if setting == "paper" else DEFAULT, workers or default_workers()
    )
    short = len(files) - len(labels)
    found = {
        ranking.value: evaluate_ranking(scores, labels, ranking) for ranking in (Ranking.CC, Ranking.COMBINED)
    }
    for method in methods:
        labels, distances = score_baseline(files, method, workers or default_workers())
        short += len(files) - len(labels)
        found[method.value] = evaluate(distances, labels, larger_is_closer=False)
    lines = compared(found)
    if as_json:
        typer.echo(
            json.dumps(
                {
                    "collection": folder.resolve().name,
                    "setting": setting,
                    "shapes": found["cc"].shapes,
                    "classes": [line.as_json() for line in lines],
                    "mean": {"paper": ALL_CATEGORIES, "here": means(lines)},
                }
            )
        )
    else:
        typer.echo(markdown(lines))
    if short:
        fail(f"{short} times a file could not be used")


def compared(found: Mapping[str, Evaluation]) -> list[Line]:
    """One line for each class: the classes of the paper in its order, then the others by name.

    A class is left out where a method has fewer than two of its shapes.
    """
    shared = set.intersection(*(set(figures.per_class) for figures in found.values()))
    names = {name.casefold(): name for name in sorted(shared)}
    ordered = [(names.pop(row.label), row) for row in TABLE_2 if row.label in names]
    return [
        Line(name, row, {by: 100.0 * figures.per_class[name].nn for by, figures in found.items()})
        for name, row in [*ordered, *((name, None) for name in sorted(names.values()))]
    ]


def means(lines: list[Line]) -> dict[str, float]:
    """Mean accuracy over the lines, by method."""
    return {by: float(np.mean([line.here[by] for line in lines])) for by in lines[0].here}


def markdown(lines: list[Line]) -> str:
    """Return the table, and sentences that compare it with the paper."""
    inside = [line for line in lines if line.category is not None]
    head = [
        "category",
        *(f"paper: {name}" for name in METHODS),
        *(f"here: {TITLES[by]}" for by in lines[0].here),
    ]
    rows = [_row(line) for line in inside]
    if inside:
        printed = [
            f"{np.mean([line.category.accuracy[name] for line in inside if line.category]):.2f}"
            for name in METHODS
        ]
        rows.append([f"mean of these {len(inside)}", *printed, *_cells(means(inside))])
    rows += [_row(line) for line in lines if line.category is None]
    blank = [""] * (len(METHODS) - 1)
    rows.append(
        [f"mean of all {len(lines)} classes", f"{ALL_CATEGORIES} (of 16)", *blank, *_cells(means(lines))]
    )
    table = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    text = ["| " + " | ".join(row) + " |" for row in table]
    for by in ("cc", "combined"):
        above = sum(line.here[by] > line.category.accuracy["ours"] for line in inside if line.category)
        lowest = min(lines, key=lambda line: line.here[by])
        text += [
            "",
            f"By {by}, above the paper in {above} of its {len(inside)} categories; lowest: {lowest.label}, "
            f"{lowest.here[by]:.1f}.",
        ]
    return "\n".join(text)


def _row(line: Line) -> list[str]:
    printed = [f"{line.category.accuracy[name]:.2f}" if line.category else "" for name in METHODS]
    return [line.category.title if line.category else line.label, *printed, *_cells(line.here)]


def _cells(here: Mapping[str, float]) -> list[str]:
    return [f"{value:.1f}" for value in here.values()]
