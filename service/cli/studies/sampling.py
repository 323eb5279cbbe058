"""`isoshape sampling`: the paper's evidence for its samples, Figs. 2 and 3, on any meshes."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import Annotated

import typer
from rich import box
from rich.table import Table
from threadpoolctl import threadpool_limits

from core.errors import CoreError
from core.gallery import CLASSES, make_shape
from core.gallery.bodies import make_person
from core.io import format_of, read_mesh, readable
from core.mesh.mesh import Mesh
from core.studies.sampling.robustness import DELTAS, ROBUST_TAU
from core.studies.sampling.study import PoseMeasures, SamplingStudy, ShapeMeasures, study_pose, study_shape
from core.studies.sampling.surface import STUDY_PARAMETERS, Surface
from core.studies.sampling.trials import COMPARED_TAU, CURVE_TAUS, DEGREES, TAUS
from service.console import fail, output, progress, say
from service.datasets import find_meshes
from service.studies.sampling.page import page
from service.studies.sampling.tables import TextTable, all_tables

DRAWN = "person"
BODY_POSES = 4
Source = tuple[str, Callable[[], Mesh]]


def sampling_command(
    paths: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[PATH]...", help="Mesh files and folders of mesh files. [default: made shapes]"
        ),
    ] = None,
    *,
    poses: Annotated[
        list[Path] | None, typer.Option(help="A mesh of one body in one pose; give two or more.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write sampling.md and its pictures to this folder.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print all numbers as one JSON object.")] = False,
) -> None:
    """Measure how vertices are sampled (Figs. 2 and 3).

    The measures are the error of the fit by degree, the histogram of geodesic distances by sparse ratio, the
    selections by Lewis weight against Poisson-disk and farthest-point sampling, and the samples under noise
    and between poses, with both readings of the paper's weights. A shape takes about ten seconds.
    """
    shapes, bodies = _shapes(paths or []), _poses(paths or [], poses or [])
    found: list[ShapeMeasures] = []
    unusable = 0
    drawn: tuple[str, Surface] | None = None
    with threadpool_limits(limits=1), progress() as bar:
        task = bar.add_task("sampling", total=len(shapes) + len(bodies))
        for name, read in shapes:
            try:
                surface = Surface.of(read())
                found.append(study_shape(name, surface))
            except (CoreError, OSError) as error:
                unusable += 1
                say(f"{name}: {error}")
            else:
                if drawn is None or (not paths and name == DRAWN):
                    drawn = (name, surface)
            bar.advance(task)
        if drawn is None:
            fail("no file could be used")
        standing: list[tuple[PoseMeasures, Surface]] = []
        for name, read in bodies:
            surface = Surface.of(read())
            standing.append((study_pose(name, surface), surface))
            bar.advance(task)
        study = SamplingStudy(tuple(found), tuple(measures for measures, _ in standing))
        tables = all_tables(study)
        if out is not None:
            text = page(
                tables,
                source=_source(study, made=not paths),
                drawn=drawn[0],
                poses=[pose.name for pose in study.poses],
            )
            _write(out, text, drawn[1], study, [surface for _, surface in standing])
    if as_json:
        typer.echo(json.dumps(_object(study)))
    else:
        _print(tables)
    if unusable:
        fail(f"{unusable} of {len(shapes)} files could not be used")


def _shapes(paths: Sequence[Path]) -> list[Source]:
    if not paths:
        return [(label, partial(make_shape, label, 0)) for label in CLASSES]
    files = find_meshes(paths).files
    if not files:
        fail(f"no meshes found; the formats read are {', '.join(readable())}")
    return [(str(file.path), partial(_read, file.path)) for file in files]


def _poses(paths: Sequence[Path], poses: Sequence[Path]) -> list[Source]:
    if len(poses) == 1:
        fail("one pose cannot be compared; name two or more", status=2)
    if poses or paths:
        return [(str(path), partial(_read, path)) for path in poses]
    return [(f"one person, pose {pose + 1}", partial(make_person, 0, pose)) for pose in range(BODY_POSES)]


def _read(path: Path) -> Mesh:
    return read_mesh(path.read_bytes(), format_of(path.name))


def _source(study: SamplingStudy, *, made: bool) -> str:
    if made:
        return (
            f"Written by `isoshape sampling --out docs`: pose 0 of each of the gallery's {len(study.shapes)} "
            f"classes, and one person in {len(study.poses)} poses. The same command gives the same numbers."
        )
    return f"Written by `isoshape sampling`, on {len(study.shapes)} mesh file(s)."


def _object(study: SamplingStudy) -> dict[str, object]:
    """Return the object that `--json` prints."""
    return {
        "degrees": DEGREES,
        "taus": TAUS,
        "compared_tau": COMPARED_TAU,
        "curve_taus": CURVE_TAUS,
        "robust_tau": ROBUST_TAU,
        "deltas": DELTAS,
        "parameters": {
            name: getattr(STUDY_PARAMETERS.sampling, name)
            for name in ("degree", "epsilon", "coverage_power", "seed")
        },
        **asdict(study),
    }


def _print(tables: Sequence[TextTable]) -> None:
    console = output()
    for text in tables:
        table = Table(title=text.title, box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
        for i, column in enumerate(text.columns):
            # The heading is as narrow as the cells below it, where its words allow.
            width = max(len(cell) for cell in (*column.split(), *(row[i] for row in text.rows)))
            table.add_column(fill(column, width), justify="right" if i else "left", overflow="fold")
        for row in text.rows:
            table.add_row(*row)
        console.print(table)
        console.print(text.shows, end="\n\n")


def _write(folder: Path, text: str, drawn: Surface, study: SamplingStudy, poses: Sequence[Surface]) -> None:
    # Here, because matplotlib takes a second to import and needs a folder for its fonts, which a service on a
    # read-only disk does not have.
    from service.studies.sampling.figures import (  # noqa: PLC0415
        fit_figure,
        methods_figure,
        noise_figure,
        poses_figure,
        ratio_figure,
    )

    folder.mkdir(parents=True, exist_ok=True)
    pictures = {
        "fit": fit_figure(drawn, study.shapes),
        "ratio": ratio_figure(drawn),
        "methods": methods_figure(drawn, study.shapes),
        "noise": noise_figure(drawn),
    }
    if poses:
        pictures["poses"] = poses_figure(poses)
    for name, data in pictures.items():
        (folder / f"sampling-{name}.png").write_bytes(data)
    (folder / "sampling.md").write_text(text, encoding="utf-8")
