"""Searches with many files on disk, sent by batches."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from service.client import Client, ProblemError
from service.http.problem_document import Cause
from service.search.schemas import QueryAnswer

BATCH_FILES, BATCH_BYTES = 16, 16 * 1024**2
"""The files that are sent together. A service takes 100, of the size of one upload."""

AWAY = {"cluster-unavailable", "not-ready", "pipeline-unavailable", "shutting-down", "storage-unavailable"}
"""Problems of a service that lie in no file."""


def answers(
    client: Client,
    paths: Sequence[Path],
    **options: Any,  # noqa: ANN401
) -> Iterator[tuple[Path, QueryAnswer | str]]:
    """Yield each file with the answer to it, or the reason why there is none.

    The options are those of `Client.query_batch`.
    """
    for batch in batches(paths):
        yield from zip(batch, _answers(client, batch, options), strict=True)


def batches(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """Yield files that are sent together; one that is larger than a batch is sent alone."""
    batch: list[Path] = []
    free = BATCH_BYTES
    for path in paths:
        size = path.stat().st_size if path.is_file() else 0
        if batch and (size > free or len(batch) == BATCH_FILES):
            yield batch
            batch, free = [], BATCH_BYTES
        batch.append(path)
        free -= size
    if batch:
        yield batch


def _answers(client: Client, batch: Sequence[Path], options: dict[str, Any]) -> list[QueryAnswer | str]:
    """Return the answers to a batch. One that is refused, or has an unreadable file, is sent file by file.

    A service that cannot work now is not asked again for each file.
    """
    try:
        given = client.query_batch(batch, **options).answers
        return [answer.text if isinstance(answer, Cause) else answer for answer in given]
    except (ProblemError, OSError) as error:
        if len(batch) == 1 or (isinstance(error, ProblemError) and error.kind in AWAY):
            return [(error.strerror if isinstance(error, OSError) else None) or str(error)] * len(batch)
        return [answer for path in batch for answer in _answers(client, [path], options)]
