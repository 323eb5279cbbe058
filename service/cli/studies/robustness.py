"""`isoshape robustness`: retrieval of perturbed queries on a labelled collection, the paper's Fig. 9."""

import json
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from core.parameters import DEFAULT
from core.studies.robustness import KINDS, TAU, TAUS, RobustnessStudy
from service.cli.options import Workers
from service.console import fail, output, progress, say
from service.datasets import read_collection
from service.studies.pairwise_scores import default_workers, worker_pool
from service.studies.robustness.perturbed_queries import (
    clean_gallery,
    clean_retrieval,
    on_disk,
    perturbed_level,
    tau_level,
)
from service.studies.robustness.table import table
from service.studies.subset import spread

NAMES = (*(kind.name for kind in KINDS), TAU)


def robustness_command(
    folder: Annotated[
        Path,
        typer.Argument(metavar="DIR", help="Folder of meshes with labels.csv, or with a folder a class."),
    ],
    *,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write robustness.md and its pictures to this folder.")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of every random perturbation.")] = 3,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help=f"One of {', '.join(NAMES)}; repeatable.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print all numbers as one JSON object.")] = False,
    limit: Annotated[
        int | None, typer.Option(min=2, help="Use only this many shapes, spread over the classes.")
    ] = None,
    workers: Workers = None,
) -> None:
    """Measure retrieval of perturbed queries (Fig. 9).

    The perturbations are noise, holes, parts cut away, decimation, subdivision, triangle soup, loose parts
    and the sparse ratio tau, each by several amounts. The table has the nearest neighbour by CC and by the
    combined score; with holes and cuts also the nearest neighbour of a partial query. One amount with one
    seed takes about as long as two evaluations of the collection.
    """
    chosen = set(only or NAMES)
    if unknown := sorted(chosen - set(NAMES)):
        fail(f"{unknown[0]} is none of {', '.join(NAMES)}", status=2)
    files = read_collection(folder)
    if limit is not None:
        files = spread(files, limit)
    study, used = _study(folder.resolve().name, files, chosen, seeds, workers or default_workers())
    if out is not None:
        options = "".join(f" --only {name}" for name in NAMES if name in chosen) if only else ""
        options += f" --limit {limit}" if limit is not None else ""
        _write(out, study, f"isoshape robustness {folder.resolve().name} --out docs --seeds {seeds}{options}")
    if as_json:
        typer.echo(json.dumps(asdict(study)))
    else:
        _print(study)
    if used < len(files):
        fail(f"{len(files) - used} of {len(files)} files could not be used")


def _study(
    collection: str, files: list[tuple[Path, str]], chosen: set[str], seeds: int, workers: int
) -> tuple[RobustnessStudy, int]:
    """Return the study, and the number of files used; a message names each file that cannot be used."""
    levels = []
    kinds = [kind for kind in KINDS if kind.name in chosen]
    with progress() as bar:
        with worker_pool(DEFAULT, workers) as pool:
            task = bar.add_task("embedding", total=len(files))
            gallery = clean_gallery(pool, files, say, partial(bar.advance, task))
            count = len(gallery.files)
            if not gallery.files:
                fail("no file could be used")
            task = bar.add_task("clean queries", total=count * (count - 1) // 2)
            clean = clean_retrieval(pool, gallery, partial(bar.advance, task))
            with on_disk(gallery) as stored:
                for kind in kinds:
                    runs = sum(1 if amount in kind.certain else seeds for amount in kind.amounts)
                    task = bar.add_task(kind.title, total=count * runs)
                    levels += [
                        perturbed_level(
                            pool, gallery, stored, kind, amount, seeds, say, partial(bar.advance, task)
                        )
                        for amount in kind.amounts
                    ]
        if TAU in chosen:
            task = bar.add_task(TAU, total=2 * count * len(TAUS))
            levels += [tau_level(gallery, tau, workers, say, partial(bar.advance, task)) for tau in TAUS]
    study = RobustnessStudy(collection, count, len(set(gallery.labels)), seeds, clean, tuple(levels))
    return study, count


def _print(study: RobustnessStudy) -> None:
    found = table(study)
    shown = Table(title=found.title, box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for i, column in enumerate(found.columns):
        shown.add_column(column, justify="right" if i else "left", overflow="fold")
    for row in found.rows:
        shown.add_row(*row)
    console = output()
    console.print(shown)
    console.print(found.shows)


def _write(folder: Path, study: RobustnessStudy, command: str) -> None:
    # Here, and not above: see the note in `service.cli.studies.sampling`.
    from service.studies.robustness.figures import curves_figure, shapes_figure  # noqa: PLC0415
    from service.studies.robustness.page import page  # noqa: PLC0415

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robustness.png").write_bytes(curves_figure(study))
    (folder / "robustness-shapes.png").write_bytes(shapes_figure())
    (folder / "robustness.md").write_text(page(study, command), encoding="utf-8")
