"""What the running service is made of."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Event

from core.patches import Bytes
from service.access.gate import Gate
from service.compute.at_work import AtWork
from service.compute.pool import LocalPool
from service.compute.work import Work
from service.compute.workers import Workers
from service.idempotency.keys import InFlight
from service.metrics import Metrics
from service.pipelines.active import Pipelines
from service.search.shelf import Shelf
from service.settings import Settings
from service.storage.database import Database


@dataclass(frozen=True)
class Parts:
    """Everything that lives from the start of the service to its end.

    `threads` compare embeddings, and `searches` counts the searches that have them compare.
    `comparing_is_ready` is set once what they run is loaded, and embeddings are ready for it. `patches` are
    those of stored shapes that were asked for.
    """

    settings: Settings
    database: Database
    pool: Workers
    readers: LocalPool
    work: Work
    pipelines: Pipelines
    gate: Gate
    in_flight: InFlight
    metrics: Metrics
    threads: ThreadPoolExecutor
    searches: AtWork
    comparing_is_ready: Event
    patches: Shelf[Bytes]
