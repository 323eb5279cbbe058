"""What the running service is made of."""

from dataclasses import dataclass

from service.access.gate import Gate
from service.compute.pool import LocalPool
from service.compute.work import Work
from service.metrics import Metrics
from service.search.signatures import SignatureIndex
from service.settings import Settings
from service.storage.database import Database


@dataclass(frozen=True)
class Parts:
    """Everything that lives from the start of the service to its end."""

    settings: Settings
    database: Database
    pool: LocalPool
    readers: LocalPool
    work: Work
    index: SignatureIndex
    gate: Gate
    metrics: Metrics

    @property
    def fingerprint(self) -> str:
        """Of the pipeline in use."""
        return self.work.pipeline.fingerprint
