"""Arguments and options that several commands share."""

from pathlib import Path
from typing import Annotated, Literal

import typer

Collection = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of meshes with labels.csv, or with a folder a class.")
]
"""A labelled collection."""

Workers = Annotated[
    int | None,
    typer.Option(
        min=1, envvar="ISOSHAPE_WORKERS", help="Worker processes. [default: one for each processor]"
    ),
]
"""Number of processes that compute, by `service.evaluation.pairwise_scores.worker_pool`."""

AsJson = Annotated[bool, typer.Option("--json", help="Print all numbers as one JSON object.")]

Setting = Annotated[Literal["paper", "default"], typer.Option(help="Parameters of the method.")]

Limit = Annotated[int | None, typer.Option(min=2, help="Use only this many shapes, spread over the classes.")]
