"""`isoshape correspondence`: matches between poses of one body against the truth."""

import json
from dataclasses import asdict
from functools import partial
from importlib.util import find_spec
from operator import call
from pathlib import Path
from statistics import fmean
from typing import Annotated

import typer

from core.evaluation.correspondence_errors import MOST_ERROR, study_body, study_individuals
from core.gallery import CLASSES
from core.parameters import DEFAULT
from service.cli.evaluation.options import AsJson, Workers
from service.console import counted, fail, print_table, progress
from service.evaluation.pairwise_scores import in_order, worker_pool
from service.evaluation.template_truth import ORIENTED, OURS, PLAIN, read_truth, study_truth, summary

MEANS = ("samples", "vertices", "direct")
"""The errors whose means are told."""


def correspondence_command(
    *,
    only: Annotated[
        list[str] | None, typer.Option(metavar="CLASS", help=f"One of {', '.join(CLASSES)}; repeatable.")
    ] = None,
    poses: Annotated[
        int, typer.Option(min=2, help="Poses of each body; every pair of poses is matched.")
    ] = 4,
    bodies: Annotated[int, typer.Option(min=1, help="Individuals of each class.")] = 1,
    individuals: Annotated[
        bool,
        typer.Option("--individuals", help="Match individuals, --bodies of them (at least 2), not poses."),
    ] = False,
    remeshed: Annotated[
        bool, typer.Option("--remeshed", help="Remesh the second shape of each pair: a harder test.")
    ] = False,
    check: Annotated[
        bool, typer.Option("--check", help=f"Fail if the mean error of a class is above {MOST_ERROR}.")
    ] = False,
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Real meshes: labels.csv (file,class,template), and NAME.vts, NAME.sym.vts beside each.",
        ),
    ] = None,
    pairs: Annotated[
        int, typer.Option(min=1, help="With --truth: ordered pairs of one class, and of two classes.")
    ] = 100,
    seed: Annotated[int, typer.Option(min=0, help="With --truth: draws the pairs.")] = 0,
    peers: Annotated[bool, typer.Option("--peers", help="With --truth: measure pyfmaps too.")] = False,
    as_json: AsJson = False,
    workers: Workers = None,
) -> None:
    """Measure correspondences against the true ones.

    The shapes are bodies made by code, whose poses have the same vertices in the same order. The error is the
    mean geodesic distance between the vertex found and the true vertex, over the square root of the area, up
    to the symmetries of the class. It is measured for the matched samples, and for all vertices by the dense
    correspondence; there the direct error, without symmetries, stands beside it. With --individuals each body
    of a class, in a pose of its own, is matched with each other one; their solids give the truth.

    With --truth the meshes are those of a folder. Line i of NAME.vts is the number, from 1, of the vertex of
    NAME that is vertex i of the template; NAME.sym.vts has its mirror image. The error of the dense
    correspondence is measured at 400 template vertices: the direct one, and the one up to the symmetry. Pairs
    are of one class, and of two classes that share a template. Seconds are of processor, once embeddings and
    eigenfunctions of both meshes are there.
    """
    if truth is not None:
        _measure_truth(truth, pairs, seed, workers, peers=peers, as_json=as_json)
        return
    if unknown := sorted(set(only or ()) - set(CLASSES)):
        fail(f"{unknown[0]} is none of {', '.join(CLASSES)}", status=2)
    if individuals and (bodies < 2 or remeshed):
        fail("--individuals needs --bodies of at least 2, and no --remeshed", status=2)
    labels = [label for label in CLASSES if not only or label in only]
    if individuals:
        studies = [partial(study_individuals, label, bodies, DEFAULT) for label in labels]
    else:
        studies = [
            partial(study_body, label, body, poses, DEFAULT, remeshed=remeshed)
            for label in labels
            for body in range(bodies)
        ]
    with worker_pool(DEFAULT, workers) as pool, progress() as bar:
        errors = in_order(pool, call, studies, counted(bar, "matching bodies", len(studies)))
    by_class = {label: [body for body in errors if body.label == label] for label in labels}
    means = {
        label: {field: fmean(body.mean(field) for body in measured) for field in MEANS}
        for label, measured in by_class.items()
    }
    overall = {field: fmean(mean[field] for mean in means.values()) for field in MEANS}
    if as_json:
        classes = {
            label: {"mean": means[label]["vertices"], "direct": means[label]["direct"], "bodies": measured}
            for label, measured in by_class.items()
        }
        report = {"most_error": MOST_ERROR, "mean": overall["vertices"], "classes": classes}
        typer.echo(json.dumps(report, default=asdict))
    else:
        rows = []
        for label, measured in by_class.items():
            of_pairs = [pair.vertices for body in measured for pair in body.pairs]
            within = sum(error <= MOST_ERROR for error in of_pairs)
            numbers = (f"{mean:.3f}" for mean in (*means[label].values(), max(of_pairs)))
            rows.append([label, str(len(of_pairs)), *numbers, str(within)])
        rows.append(["mean", "", *(f"{mean:.3f}" for mean in overall.values()), "", ""])
        matched = f"{bodies} individuals of each class" if individuals else f"{poses} poses of each body"
        print_table(
            f"geodesic error / root of the area, {matched}, matched in pairs",
            (
                "class",
                "pairs",
                "samples",
                "all vertices",
                "direct",
                "worst pair",
                f"pairs within {MOST_ERROR}",
            ),
            rows,
            last=1,
        )
    over = [label for label, mean in means.items() if mean["vertices"] > MOST_ERROR]
    if check and over:
        fail(f"the mean error is above {MOST_ERROR} for {', '.join(over)}")


def _measure_truth(
    folder: Path, pairs: int, seed: int, workers: int | None, *, peers: bool, as_json: bool
) -> None:
    if peers and find_spec("pyFM") is None:
        fail("pyfmaps is not installed: pip install isoshape[peers]", status=2)
    methods = (OURS, PLAIN, ORIENTED) if peers else (OURS,)
    errors = study_truth(read_truth(folder), pairs, seed, workers, methods)
    if as_json:
        objects = {
            method: {kind: summary(measured) if measured else None for kind, measured in kinds.items()}
            for method, kinds in errors.items()
        }
        typer.echo(json.dumps(objects.pop(OURS) | objects))
        return
    rows = []
    for method, kinds in errors.items():
        for kind, measured in kinds.items():
            if measured:
                count, direct, symmetric, seconds = summary(measured).values()
                values = *direct.values(), *symmetric.values(), seconds["mean"]
                numbers = (f"{value:.3f}" for value in values)
                rows.append([method.replace("_", ", "), kind, str(count), *numbers])
    print_table(
        "geodesic error / root of the area of the dense correspondence",
        ("method", "classes", "pairs", "direct, mean", "median", "up to symmetry, mean", "median", "seconds"),
        rows,
        left=2,
    )
