"""The components of a running service, and the dependency that gives them to endpoints."""

from collections.abc import Hashable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Event
from typing import Annotated, Any

from cachetools import LRUCache
from fastapi import Depends, Request

from core.descriptors.registry import ShapeDescriptors
from service.auth.gate import Gate
from service.compute.pool import LocalPool
from service.compute.request_queue import ActivityGate, Executor, RequestQueue
from service.http.idempotency import InFlight
from service.index.cache import EmbeddingCache
from service.index.signature_table import SurfaceMeasurements
from service.observability.metrics import Metrics
from service.pipelines.active import Pipelines
from service.settings import Settings
from service.storage.database import Database
from service.turns import Shares, Turns


@dataclass(frozen=True)
class Container:
    """All components that live from the start of the service to its end.

    `threads` compare embeddings in batches, of which each worker has one and one that waits; `batches` gives
    clients their turns, and `searches` counts the searches that use them. `downloads` are the files that are
    being sent, and `file_batches` the queries with several files. `comparing_is_ready` is set when compiled
    code and the first match records are loaded. `descriptors` caches descriptors of stored shapes by the
    number of the embedding. `judging` has the shapes that are compared with others to find near-identical
    ones, and whether the search is for variants. `relations` has what registration told of the latest pairs
    (`service.search.likeness`).
    """

    settings: Settings
    database: Database
    pool: Executor
    readers: LocalPool
    queue: RequestQueue
    pipelines: Pipelines
    gate: Gate
    in_flight: InFlight
    metrics: Metrics
    threads: ThreadPoolExecutor
    batches: Turns
    downloads: Shares
    file_batches: Shares
    searches: ActivityGate
    comparing_is_ready: Event
    descriptors: EmbeddingCache[ShapeDescriptors]
    measurements: SurfaceMeasurements
    judging: set[tuple[int, bool]]
    relations: LRUCache[Hashable, Any]


def _container(request: Request) -> Container:
    container = request.app.state.container
    assert isinstance(container, Container)
    return container


Service = Annotated[Container, Depends(_container)]
