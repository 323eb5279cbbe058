"""Many uploads, several at the same time."""

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from service.client import Client, ProblemError, Upload

# Enough to keep the workers of a small machine busy while files are read and sent.
AT_ONCE = 4


@dataclass(frozen=True)
class Item:
    """A mesh to store: the path of its file or its bytes, with its tags and metadata.

    `split` is that of `Client.upload`.
    """

    name: str
    data: bytes | Path
    tags: tuple[str, ...]
    metadata: Mapping[str, str] | None = None
    split: Literal["parts"] | None = None

    @property
    def origin(self) -> str:
        """The name of the mesh in messages."""
        return str(self.data) if isinstance(self.data, Path) else self.name


def upload_all(
    client: Client, items: Sequence[Item], at_once: int = AT_ONCE
) -> Iterator[tuple[Item, Upload | str]]:
    """Yield each item with its upload or the cause of its refusal, in the order in which the uploads end.

    If the service is gone, no further upload begins.

    Raises
    ------
    ClientError
        The service does not answer, or gives an unexpected answer.
    """
    pool = ThreadPoolExecutor(at_once)
    try:
        futures: dict[Future[Upload | str], Item] = {
            pool.submit(_upload, client, item): item for item in items
        }
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _upload(client: Client, item: Item) -> Upload | str:
    try:
        data = item.data.read_bytes() if isinstance(item.data, Path) else item.data
        return client.upload((item.name, data), tags=item.tags, metadata=item.metadata, split=item.split)
    except ProblemError as error:
        return f"{error.kind}: {error.problem.detail}"
    except OSError as error:
        return error.strerror or str(error)
