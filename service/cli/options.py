"""Options that several commands share."""

from typing import Annotated

import typer

Workers = Annotated[
    int | None,
    typer.Option(
        min=1, envvar="ISOSHAPE_WORKERS", help="Worker processes. [default: one for each processor]"
    ),
]
"""Number of processes that compute; `service.studies.pairwise_scores.default_workers` where None."""
