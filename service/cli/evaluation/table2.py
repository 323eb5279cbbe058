"""`isoshape table2`: the paper's Table 2 beside the accuracies measured here, category by category."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer

from core.evaluation.classification import ALL_CATEGORIES, METHODS, TABLE_2, Category
from core.evaluation.retrieval_measures import Evaluation, evaluate
from core.parameters import DEFAULT, PAPER
from service.cli.evaluation.options import AsJson, Collection, Limit, Setting, Workers
from service.console import fail, print_table
from service.evaluation.retrieval import (
    collection_files,
    evaluate_ranking,
    require,
    score_baseline,
    score_collection,
)

BASELINES = {"shapedna": "ShapeDNA", "icp": "ICP", "mds": "MDS"}
"""The baselines and their titles."""


@dataclass(frozen=True)
class Line:
    """A class: its category in the paper, if any, and the accuracies measured here by method, in per cent."""

    label: str
    category: Category | None
    here: Mapping[str, float]


def table2_command(
    folder: Collection,
    *,
    setting: Setting = "default",
    baselines: Annotated[
        bool, typer.Option("--baselines/--no-baselines", help="Measure ShapeDNA, ICP and MDS too.")
    ] = True,
    as_json: AsJson = False,
    limit: Limit = None,
    workers: Workers = None,
) -> None:
    """Measure the paper's Table 2, category by category.

    The accuracy of a class is the share of its shapes whose nearest neighbour is of the same class. Classes
    and the paper's categories are matched by the names of the Princeton Segmentation Benchmark (Human,
    Fourleg, Airplane, Bird, Fish, Cup). Libraries provide ICP and MDS, but neither
    Parts nor TPS-RPM.
    """
    files = collection_files(folder, limit)
    methods = tuple(BASELINES) if baselines else ()
    for method in methods:
        require(method)
    labels, scores = score_collection(files, PAPER if setting == "paper" else DEFAULT, workers)
    unusable = len(files) - len(labels)
    figures = {
        "cc": evaluate_ranking(scores, labels, "cc"),
        "combined": evaluate_ranking(scores, labels, "combined"),
    }
    for method in methods:
        labels, distances = score_baseline(files, method, workers)
        unusable += len(files) - len(labels)
        figures[method] = evaluate(distances, labels, larger_is_closer=False)
    lines = compared(figures)
    name = folder.resolve().name
    if as_json:
        classes = [
            {
                "class": line.label,
                "category": line.category and line.category.title,
                "paper": line.category and line.category.accuracy,
                "here": line.here,
            }
            for line in lines
        ]
        report = {"collection": name, "setting": setting, "shapes": figures["cc"].shapes, "classes": classes}
        typer.echo(json.dumps(report | {"mean": {"paper": ALL_CATEGORIES, "here": means(lines)}}))
    else:
        headings, rows = table(lines)
        print_table(f"Table 2 and {name}, setting {setting}: accuracies in per cent", headings, rows)
    if unusable:
        fail(f"{unusable} times a file could not be used")


def compared(figures: Mapping[str, Evaluation]) -> list[Line]:
    """Return one line for each class: the classes of the paper in its order, then the others by name.

    A class is left out where a method has fewer than two of its shapes.
    """
    shared = set.intersection(*(set(evaluation.per_class) for evaluation in figures.values()))
    names = {name.casefold(): name for name in sorted(shared)}
    ordered = [(names.pop(row.label), row) for row in TABLE_2 if row.label in names]
    return [
        Line(name, row, {by: 100.0 * evaluation.per_class[name].nn for by, evaluation in figures.items()})
        for name, row in [*ordered, *((name, None) for name in sorted(names.values()))]
    ]


def means(lines: list[Line]) -> dict[str, float]:
    """Return the mean accuracy over the lines, by method."""
    return {by: float(np.mean([line.here[by] for line in lines])) for by in lines[0].here}


def table(lines: list[Line]) -> tuple[list[str], list[list[str]]]:
    """Return Table 2, the paper's accuracies beside those here, with means: headings and rows."""

    def row(title: str, here: Mapping[str, float], paper: Sequence[float] = ()) -> list[str]:
        printed = [f"{accuracy:.2f}" for accuracy in paper] or [""] * len(METHODS)
        return [title, *printed, *(f"{accuracy:.1f}" for accuracy in here.values())]

    headings = ["category", *(f"paper: {name}" for name in METHODS)]
    headings += [f"here: {BASELINES.get(by, by)}" for by in lines[0].here]
    inside = [(line.category, line) for line in lines if line.category is not None]
    rows = [row(category.title, line.here, [*category.accuracy.values()]) for category, line in inside]
    if inside:
        paper = np.mean([[*category.accuracy.values()] for category, _ in inside], axis=0)
        rows.append(row(f"mean of these {len(inside)}", means([line for _, line in inside]), paper.tolist()))
    rows += [row(line.label, line.here) for line in lines if line.category is None]
    rows.append(row(f"mean of all {len(lines)} classes", means(lines)))
    rows[-1][1] = f"{ALL_CATEGORIES} (of 16)"
    return headings, rows
