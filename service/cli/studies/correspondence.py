"""`isoshape correspondence`: matches between poses of one body against the truth."""

import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import asdict
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from core.gallery import CLASSES
from core.parameters import DEFAULT
from core.studies.correspondence import MOST_ERROR, BodyErrors, study_body, study_individuals
from service.cli.options import Workers
from service.console import fail, output, progress
from service.studies.pairwise_scores import default_workers, worker_pool
from service.studies.truth import ORIENTED, OURS, PLAIN, TruthSummary, read_truth, study_truth


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
    as_json: Annotated[bool, typer.Option("--json", help="Print all numbers as one JSON object.")] = False,
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
    are of one class, and of two classes that share a template.
    """
    if truth is not None:
        _measure_truth(truth, pairs, seed, workers or default_workers(), peers=peers, as_json=as_json)
        return
    if unknown := sorted(set(only or ()) - set(CLASSES)):
        fail(f"{unknown[0]} is none of {', '.join(CLASSES)}", status=2)
    if individuals and (bodies < 2 or remeshed):
        fail("--individuals needs --bodies of at least 2, and no --remeshed", status=2)
    labels = [label for label in CLASSES if not only or label in only]
    if individuals:
        tasks = [partial(study_individuals, label, bodies, DEFAULT) for label in labels]
    else:
        tasks = [
            partial(study_body, label, body, poses, DEFAULT, remeshed=remeshed)
            for label in labels
            for body in range(bodies)
        ]
    found = _study(tasks, workers or default_workers())
    by_class = {label: [study for study in found if study.label == label] for label in labels}
    if as_json:
        typer.echo(json.dumps(_object(by_class)))
    else:
        matched = f"{bodies} individuals of each class" if individuals else f"{poses} poses of each body"
        output().print(_table(by_class, matched))
    over = [label for label, studies in by_class.items() if _mean(studies) > MOST_ERROR]
    if check and over:
        fail(f"the mean error is above {MOST_ERROR} for {', '.join(over)}")


def _measure_truth(folder: Path, pairs: int, seed: int, workers: int, *, peers: bool, as_json: bool) -> None:
    if peers and find_spec("pyFM") is None:
        fail("pyfmaps is not installed: pip install isoshape[peers]", status=2)
    methods = (OURS, PLAIN, ORIENTED) if peers else (OURS,)
    found = study_truth(read_truth(folder), pairs, seed, workers, methods)
    if as_json:
        objects = {
            method: {kind: one and one.as_json() for kind, one in kinds.items()}
            for method, kinds in found.items()
        }
        typer.echo(json.dumps(objects.pop(OURS) | objects))
    else:
        output().print(_truth_table(found))


def _truth_table(found: Mapping[str, Mapping[str, TruthSummary | None]]) -> Table:
    table = Table(
        title="geodesic error / root of the area of the dense correspondence",
        box=box.SIMPLE_HEAD,
        collapse_padding=True,
    )
    for name in ("method", "classes"):
        table.add_column(name)
    for name in ("pairs", "direct, mean", "median", "up to symmetry, mean", "median"):
        table.add_column(name, justify="right")
    for method, kinds in found.items():
        for kind, one in kinds.items():
            if one is not None:
                spreads = (one.direct, one.symmetric)
                cells = [f"{value:.3f}" for spread in spreads for value in (spread.mean, spread.median)]
                table.add_row(method.replace("_", ", "), kind, str(len(one.errors)), *cells)
    return table


def _study(tasks: Sequence[Callable[[], BodyErrors]], workers: int) -> list[BodyErrors]:
    with worker_pool(DEFAULT, workers) as pool, progress() as bar:
        task = bar.add_task("matching bodies", total=len(tasks))
        futures = [pool.submit(one) for one in tasks]
        for future in as_completed(futures):
            future.result()
            bar.advance(task)
        return [future.result() for future in futures]


def _mean(studies: list[BodyErrors]) -> float:
    return sum(study.vertices for study in studies) / len(studies)


def _direct(studies: list[BodyErrors]) -> float:
    return sum(study.direct for study in studies) / len(studies)


def _object(by_class: dict[str, list[BodyErrors]]) -> dict[str, object]:
    return {
        "most_error": MOST_ERROR,
        "mean": sum(map(_mean, by_class.values())) / len(by_class),
        "classes": {
            label: {
                "mean": _mean(studies),
                "direct": _direct(studies),
                "bodies": [asdict(study) for study in studies],
            }
            for label, studies in by_class.items()
        },
    }


def _table(by_class: dict[str, list[BodyErrors]], matched: str) -> Table:
    table = Table(
        title=f"geodesic error / root of the area, {matched}, matched in pairs",
        box=box.SIMPLE_HEAD,
        collapse_padding=True,
    )
    table.add_column("class")
    for name in ("pairs", "samples", "all vertices", "direct", "worst pair", f"pairs within {MOST_ERROR}"):
        table.add_column(name, justify="right")
    means = []
    for label, studies in by_class.items():
        pairs = [pair for study in studies for pair in study.pairs]
        samples = sum(pair.samples for pair in pairs) / len(pairs)
        means.append((samples, _mean(studies)))
        table.add_row(
            label,
            str(len(pairs)),
            f"{samples:.3f}",
            f"{_mean(studies):.3f}",
            f"{_direct(studies):.3f}",
            f"{max(pair.vertices for pair in pairs):.3f}",
            str(sum(pair.vertices <= MOST_ERROR for pair in pairs)),
        )
    table.add_section()
    samples, vertices = (sum(values) / len(means) for values in zip(*means, strict=True))
    direct = sum(map(_direct, by_class.values())) / len(by_class)
    table.add_row("mean", "", f"{samples:.3f}", f"{vertices:.3f}", f"{direct:.3f}", "", "")
    return table
