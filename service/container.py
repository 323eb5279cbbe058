"""What the running service is made of."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Event

from core.arrays import Bytes
from service.auth.gate import Gate
from service.compute.activity_gate import ActivityGate
from service.compute.pool import LocalPool
from service.compute.work import Work
from service.compute.workers import Workers
from service.http.idempotency.keys import InFlight
from service.index.cache import EmbeddingCache
from service.observability.metrics import Metrics
from service.pipelines.active import Pipelines
from service.settings import Settings
from service.storage.database import Database


@dataclass(frozen=True)
class Container:
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
    searches: ActivityGate
    comparing_is_ready: Event
    spin_images: EmbeddingCache[Bytes]
