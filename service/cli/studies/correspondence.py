"""`isoshape correspondence`: matches between poses of one body against the truth."""

import json
from concurrent.futures import as_completed
from dataclasses import asdict
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from core.gallery import CLASSES
from core.parameters import DEFAULT
from core.studies.correspondence import MOST_ERROR, BodyErrors, study_body
from service.cli.options import Workers
from service.console import fail, output, progress
from service.studies.pairwise_scores import default_workers, worker_pool


def command(
    *,
    only: Annotated[
        list[str] | None, typer.Option(metavar="CLASS", help=f"One of {', '.join(CLASSES)}; repeatable.")
    ] = None,
    poses: Annotated[
        int, typer.Option(min=2, help="Poses of each body; every pair of poses is matched.")
    ] = 4,
    bodies: Annotated[int, typer.Option(min=1, help="Individuals of each class.")] = 1,
    remeshed: Annotated[
        bool, typer.Option("--remeshed", help="Remesh the second shape of each pair: a harder test.")
    ] = False,
    check: Annotated[
        bool, typer.Option("--check", help=f"Fail if the mean error of a class is above {MOST_ERROR}.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print all numbers as one JSON object.")] = False,
    workers: Workers = None,
) -> None:
    """Measure correspondences against the true ones.

    The shapes are bodies made by code, whose poses have the same vertices in the same order. The error is the
    mean geodesic distance between the vertex found and the true vertex, over the square root of the area, up
    to the symmetries of the class. It is measured for the matched samples, and for all vertices by the dense
    correspondence.
    """
    if unknown := sorted(set(only or ()) - set(CLASSES)):
        fail(f"{unknown[0]} is none of {', '.join(CLASSES)}", status=2)
    labels = [label for label in CLASSES if not only or label in only]
    found = _study(labels, bodies, poses, workers or default_workers(), remeshed=remeshed)
    by_class = {label: [study for study in found if study.label == label] for label in labels}
    if as_json:
        typer.echo(json.dumps(_object(by_class)))
    else:
        output().print(_table(by_class, poses))
    over = [label for label, studies in by_class.items() if _mean(studies) > MOST_ERROR]
    if check and over:
        fail(f"the mean error is above {MOST_ERROR} for {', '.join(over)}")


def _study(labels: list[str], bodies: int, poses: int, workers: int, *, remeshed: bool) -> list[BodyErrors]:
    wanted = [(label, body) for label in labels for body in range(bodies)]
    with worker_pool(DEFAULT, workers) as pool, progress() as bar:
        task = bar.add_task("matching poses", total=len(wanted))
        futures = [
            pool.submit(study_body, label, body, poses, DEFAULT, remeshed=remeshed) for label, body in wanted
        ]
        for future in as_completed(futures):
            future.result()
            bar.advance(task)
        return [future.result() for future in futures]


def _mean(studies: list[BodyErrors]) -> float:
    return sum(study.vertices for study in studies) / len(studies)


def _object(by_class: dict[str, list[BodyErrors]]) -> dict[str, object]:
    return {
        "most_error": MOST_ERROR,
        "mean": sum(map(_mean, by_class.values())) / len(by_class),
        "classes": {
            label: {"mean": _mean(studies), "bodies": [asdict(study) for study in studies]}
            for label, studies in by_class.items()
        },
    }


def _table(by_class: dict[str, list[BodyErrors]], poses: int) -> Table:
    table = Table(
        title=f"geodesic error / root of the area, {poses} poses of each body, matched in pairs",
        box=box.SIMPLE_HEAD,
        collapse_padding=True,
    )
    table.add_column("class")
    for name in ("pairs", "samples", "all vertices", "worst pair", f"pairs within {MOST_ERROR}"):
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
            f"{max(pair.vertices for pair in pairs):.3f}",
            str(sum(pair.vertices <= MOST_ERROR for pair in pairs)),
        )
    table.add_section()
    samples, vertices = (sum(values) / len(means) for values in zip(*means, strict=True))
    table.add_row("mean", "", f"{samples:.3f}", f"{vertices:.3f}", "", "")
    return table
