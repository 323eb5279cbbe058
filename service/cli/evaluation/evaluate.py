"""`isoshape evaluate`: retrieval on a labelled collection, each shape a query against all others."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from enum import StrEnum
from typing import Annotated, Any, Literal, get_args

import typer

from core.evaluation.retrieval_measures import QUANTILES, Evaluation, evaluate, score_quantiles
from core.parameters import DEFAULT, PAPER
from service.cli.evaluation.options import Collection, Limit, Setting, Workers
from service.console import fail, print_table
from service.evaluation.retrieval import collection_files, evaluate_ranking, score_baseline, score_collection
from service.search.schemas import RankBy

HIGH_CC = 0.98
"""A CC whose share of the pairs is printed: poses of one body often reach it, other pairs hardly."""

MEASURES = ("nn", "ft", "st", "e", "dcg", "map")

HUBNESS = ("occurrence_skewness", "most_often_wrong")


Ranked = StrEnum("Ranked", ["CC", "SSD", "SIM", "COMBINED", "CONTEXTUAL", "ALL"])
"""A score that ranks the answers, or all of them."""


def evaluate_command(
    folder: Collection,
    *,
    setting: Setting = "default",
    method: Annotated[
        Literal["isoshape", "shapedna", "icp", "mds", "d2", "views"],
        typer.Option(help="Isoshape or a baseline; a baseline has one distance and no settings."),
    ] = "isoshape",
    rank_by: Annotated[
        list[Ranked] | None, typer.Option(help="Score that ranks the answers; repeatable. [default: cc]")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object, or a list of them for several rankings.")
    ] = False,
    uncapped: Annotated[
        bool, typer.Option("--uncapped", help="Remove the cap on the number of samples.")
    ] = False,
    limit: Limit = None,
    workers: Workers = None,
) -> None:
    """Measure retrieval on a labelled collection.

    Each shape is a query against all others. The measures are NN (nearest neighbour), FT and ST (first and
    second tier), E (E-measure of the first 32), DCG (discounted cumulative gain) and MAP (mean average
    precision), as in Shilane et al. 2004. Ties count against the ranking. Two more measure hubs: the skewness
    of the 10-occurrence (Radovanovic et al. 2010), and the share of the queries that have one and the same
    wrong first answer. The quantiles of CC over the pairs of one class and of two are printed too, with the
    share of the pairs whose CC is at least 0.98.

    The other methods run on the same meshes: ShapeDNA (Reuter et al. 2006) by LaPy, ICP (Besl and McKay 1992)
    by trimesh, MDS (Elad and Kimmel 2003) by scikit-learn, the shape distribution D2 (Osada et al. 2002), and
    the view descriptor of core.descriptors alone. ShapeDNA and MDS need `pip install isoshape[peers]`.
    """
    if method != "isoshape" and (rank_by or uncapped or setting != "default"):
        fail(f"--method {method} has no --setting, --rank-by or --uncapped", status=2)
    files = collection_files(folder, limit)
    name = folder.resolve().name
    if method == "isoshape":
        parameters = PAPER if setting == "paper" else DEFAULT
        if uncapped:
            parameters = parameters.with_values(sampling={"sample_cap": 0})
        labels, scores = score_collection(files, parameters, workers)
        cc = score_quantiles(scores.cc, labels, HIGH_CC)
        chosen = rank_by or [Ranked.CC]
        rankings: Iterable[Any] = get_args(RankBy) if "all" in chosen else dict.fromkeys(chosen)
        evaluations = {ranking: evaluate_ranking(scores, labels, ranking) for ranking in rankings}
    else:
        labels, distances = score_baseline(files, method, workers)
        cc = {}
        evaluations = {"distance": evaluate(distances, labels, larger_is_closer=False)}
    named = setting if method == "isoshape" else method
    if as_json:
        about = {"collection": name, "setting": named}
        objects = [about | {"rank_by": by} | _object(each, cc) for by, each in evaluations.items()]
        typer.echo(json.dumps(objects[0] if len(objects) == 1 else objects))
    else:
        _print(f"{name}, {'setting' if method == 'isoshape' else 'method'} {named}", evaluations, cc)
    if len(labels) < len(files):
        fail(f"{len(files) - len(labels)} of {len(files)} files could not be used")


def _object(figures: Evaluation, cc: Mapping[str, Mapping[str, Any]]) -> dict[str, object]:
    """Return the numbers of one ranking that `--json` prints."""
    return {
        "shapes": figures.shapes,
        "classes": len(figures.classes),
        **{name: getattr(figures, name) for name in (*MEASURES, *HUBNESS)},
        "cc": cc,
        "per_class": {name: asdict(row) for name, row in figures.per_class.items()},
    }


def _print(title: str, evaluations: Mapping[str, Evaluation], cc: Mapping[str, Mapping[str, Any]]) -> None:
    first = next(iter(evaluations.values()))
    print_table(
        f"{title}: {first.shapes} shapes, {len(first.classes)} classes",
        ("rank by", *map(str.upper, MEASURES), "skewness", "one wrong"),
        [
            [ranking, *(f"{getattr(figures, name):.3f}" for name in (*MEASURES, *HUBNESS))]
            for ranking, figures in evaluations.items()
        ],
    )
    if cc:
        rows = [
            [
                "one class" if name == "same" else "two classes",
                str(pairs["pairs"]),
                *(f"{value:.4f}" for value in pairs["quantiles"].values()),
                f"{100 * pairs['matched']:.1f} %",
            ]
            for name, pairs in cc.items()
        ]
        quantiles = (f"{100 * quantile:g} %" for quantile in QUANTILES)
        print_table("CC of pairs", ("pairs of", "pairs", *quantiles, "matched"), rows)
    for ranking, figures in evaluations.items():
        print_table(
            f"by class, ranked by {ranking}",
            ("class", "most often taken for", "shapes", "NN", "FT", "ST"),
            _by_class(figures),
            left=2,
        )


def _by_class(figures: Evaluation) -> list[list[str]]:
    rows = []
    for place, (name, row) in enumerate(figures.per_class.items()):
        taken = figures.confusion[place].copy()
        shapes = int(taken.sum())
        taken[place] = 0
        worst = f"{figures.classes[int(taken.argmax())]} ({int(taken.max())})" if taken.any() else ""
        rows.append([name, worst, str(shapes), f"{row.nn:.2f}", f"{row.ft:.2f}", f"{row.st:.2f}"])
    return rows
