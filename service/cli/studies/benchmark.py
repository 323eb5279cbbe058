"""`isoshape benchmark`: the cost of embedding and matching, against other software, size and the paper."""

import json
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from service.console import fail, output, progress
from service.studies.benchmark.archive import originals
from service.studies.benchmark.embedding import embedding_rows, shapedna
from service.studies.benchmark.functional_maps import functional_maps
from service.studies.benchmark.growth import growth_rows
from service.studies.benchmark.ingesting import ingesting_rows
from service.studies.benchmark.load import load_row
from service.studies.benchmark.matching import matching_rows
from service.studies.benchmark.meshes import read_source
from service.studies.benchmark.page import PLOT, SEARCH_PLOT, BenchmarkResults, page
from service.studies.benchmark.pictures import picture_rows
from service.studies.benchmark.searching import SIZES, by_default, searching_rows
from service.studies.benchmark.table1 import table1_rows


class Subject(StrEnum):
    """A part of the benchmark that can be measured alone."""

    EMBEDDING = "embedding"
    GROWTH = "growth"
    TABLE1 = "table1"
    MATCH = "match"
    SEARCH = "search"
    INGEST = "ingest"
    LOAD = "load"
    PICTURES = "pictures"


def benchmark_command(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="[DIR]",
            help="Folder of meshes with labels.csv, or with a folder a class. [default: made shapes]",
        ),
    ] = None,
    *,
    only: Annotated[
        list[Subject] | None, typer.Option(help="Measure only this subject; repeatable. [default: all]")
    ] = None,
    sizes: Annotated[
        list[int] | None,
        typer.Option(
            "--shapes",
            min=1,
            help="Shapes in the archive that is queried, about 75 kB of disk each; repeatable. "
            "[default: 380, 1000, 10000, 100000]",
        ),
    ] = None,
    peers: Annotated[bool, typer.Option("--peers", help="Measure LaPy and pyfmaps too.")] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write benchmark.md and its pictures to this folder.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print all numbers as one JSON object.")] = False,
) -> None:
    """Measure the time and memory of embedding and matching.

    The subjects are the stages of embedding, growth with size, the paper's Table 1, matches, queries,
    storing, load and pictures. Each figure is a median of several runs; runs of other software alternate with
    them. Measure on an idle machine, with OMP_NUM_THREADS=1.
    """
    subjects = list(dict.fromkeys(only or Subject))
    signature = matcher = None
    if peers:
        try:
            signature = shapedna() if Subject.EMBEDDING in subjects else None
            matcher = functional_maps() if Subject.MATCH in subjects else None
        except ImportError as error:
            fail(f"{error.name} is not installed: pip install isoshape[peers]", status=2)
    source = read_source(folder)
    found = BenchmarkResults()
    with progress() as bar, TemporaryDirectory() as scratch:
        task = bar.add_task("measuring", total=len(subjects))
        for subject in subjects:
            match subject:
                case Subject.EMBEDDING:
                    found.embedding.extend(embedding_rows(source, signature))
                case Subject.GROWTH:
                    found.growth.extend(growth_rows(source, Path(scratch)))
                case Subject.TABLE1:
                    found.table1.extend(table1_rows(source))
                case Subject.MATCH:
                    found.match.extend(matching_rows(source, matcher))
                case Subject.SEARCH:
                    rows, kept = searching_rows(originals(source), Path(scratch), sizes=sizes or SIZES)
                    found.search.extend(rows)
                    found.kept.extend(kept)
                case Subject.INGEST:
                    found.ingest.extend(ingesting_rows(source, Path(scratch)))
                case Subject.LOAD:
                    found.load.append(load_row(source, originals(source), Path(scratch)))
                case Subject.PICTURES:
                    found.pictures.extend(picture_rows(source, Path(scratch)))
            bar.advance(task)
    asked = " ".join(
        [
            "isoshape benchmark",
            *([folder.resolve().name] if folder else []),
            *(f"--only {subject}" for subject in subjects if only),
            *(f"--shapes {size}" for size in sizes or ()),
            *(["--peers"] if peers else []),
        ]
    )
    text = page(found, asked, picture=out is not None)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "benchmark.md").write_text(text, encoding="utf-8")
        if found.growth or found.search:
            # Here, because matplotlib takes a second to import.
            from service.studies.benchmark.plot import growth_plot, search_plot  # noqa: PLC0415

            if found.growth:
                (out / PLOT).write_bytes(growth_plot(found.growth))
            if len(by_default(found.search)) > 1:
                (out / SEARCH_PLOT).write_bytes(search_plot(found.search))
    if as_json:
        typer.echo(json.dumps(found.as_json()))
    elif out is None:
        typer.echo(text, nl=False)
    else:
        output().print(f"benchmark.md in {out}", soft_wrap=True)
