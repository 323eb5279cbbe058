"""`isoshape figures`: the paper's figures by one command."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from threadpoolctl import threadpool_limits

from core.evaluation.classification import classify
from core.gallery import make_gallery
from core.gallery.bodies import make_body
from core.io import format_of, read_mesh, write_mesh
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from service.cli.options import Workers
from service.console import fail, output, progress
from service.datasets import read_collection
from service.studies.pairwise_scores import default_workers
from service.studies.retrieval import Ranking, evaluate_ranking, score_collection
from service.studies.subset import spread

POSES = 4
SHOWN = "person"


def figures_command(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="[DIR]",
            help="Folder of meshes with labels.csv, or with a folder a class. [default: made shapes]",
        ),
    ] = None,
    *,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the pictures and figures.md.")],
    shown: Annotated[
        str | None,
        typer.Option("--class", help=f"Class of the shapes drawn alone. [default: {SHOWN}, or the first]"),
    ] = None,
    limit: Annotated[
        int | None, typer.Option(min=6, help="Use only this many shapes, spread over the classes.")
    ] = None,
    workers: Workers = None,
) -> None:
    """Draw the paper's figures of spectra, matches and classes.

    The figures are samples (Fig. 3), an eigenmap (Fig. 5), a match (Fig. 6), the first answers (Table 3), the
    classes (Fig. 10) and the confusion matrix. Without a folder the shapes are made by code, and the match
    shows one body in two poses.
    """
    # Here, because matplotlib takes a second to import.
    from service.studies.figures.classes import classes_picture  # noqa: PLC0415
    from service.studies.figures.page import page  # noqa: PLC0415
    from service.studies.figures.retrieval import confusion_figure, top_figure  # noqa: PLC0415
    from service.studies.figures.spectral import eigenmap_figure, match_figure, samples_figure  # noqa: PLC0415

    with _collection(folder) as here:
        files = read_collection(here)
        if limit is not None:
            files = spread(files, limit)
        classes = {str(path): label for path, label in files}
        names, scores = score_collection(
            [(path, str(path)) for path, _ in files], DEFAULT, workers or default_workers()
        )
        meshes = [read_mesh(Path(name).read_bytes(), format_of(name)) for name in names]
    labels = [classes[name] for name in names]
    chosen = shown or (SHOWN if SHOWN in labels else labels[0])
    if labels.count(chosen) < 2:
        fail(f"class {chosen} has no two shapes that can be used", status=2)
    pair = _pair(folder, chosen, meshes, labels)
    figures = evaluate_ranking(scores, labels, Ranking.CC)
    found = classify(scores.cc, labels, larger_is_closer=True)
    with threadpool_limits(limits=1), progress() as bar:
        task = bar.add_task("drawing", total=6)
        out.mkdir(parents=True, exist_ok=True)
        pictures: dict[str, Callable[[], bytes]] = {
            "samples": partial(samples_figure, pair[0]),
            "eigenmap": partial(eigenmap_figure, pair[0]),
            "match": partial(match_figure, *pair),
            "top": partial(top_figure, meshes, labels, scores.cc, "CC"),
            "confusion": partial(confusion_figure, figures, "CC"),
            "classes": partial(classes_picture, meshes, labels, found),
        }
        for name, draw in pictures.items():
            (out / f"figures-{name}.png").write_bytes(draw())
            bar.advance(task)
    text = page(chosen, figures, found, made=folder is None)
    (out / "figures.md").write_text(text, encoding="utf-8")
    output().print(f"six pictures and figures.md in {out}", soft_wrap=True)
    if len(names) < len(files):
        fail(f"{len(files) - len(names)} of {len(files)} files could not be used")


@contextmanager
def _collection(folder: Path | None) -> Iterator[Path]:
    """Yield the folder, or a temporary folder of made shapes."""
    if folder is not None:
        yield folder
        return
    with TemporaryDirectory() as scratch:
        for shape in make_gallery(POSES):
            path = Path(scratch) / shape.label / f"{shape.name}.ply"
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(write_mesh(shape.mesh, "ply"))
        yield Path(scratch)


def _pair(folder: Path | None, label: str, meshes: list[Mesh], labels: list[str]) -> tuple[Mesh, Mesh]:
    """Two poses of one made body, or the first two shapes of the class."""
    if folder is None:
        body = make_body(label)
        return body.posed(0), body.posed(1)
    first, second, *_ = (mesh for mesh, other in zip(meshes, labels, strict=True) if other == label)
    return first, second
