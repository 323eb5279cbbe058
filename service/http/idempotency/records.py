"""Keys and answers as they go between endpoints, service and storage."""

from dataclasses import dataclass
from datetime import datetime

from service.collection import CollectionNumber


@dataclass(frozen=True)
class Claim:
    """A request with an Idempotency-Key.

    Attributes
    ----------
    collection : CollectionNumber
        The one that the request names.
    scope : str
        Whose key it is: the digest of the API key that it came with, or empty.
    key : str
        The Idempotency-Key.
    payload : str
        A hash of what was sent.
    expires_at : datetime
        Until when its answer is kept.
    """

    collection: CollectionNumber
    scope: str
    key: str
    payload: str
    expires_at: datetime


@dataclass(frozen=True)
class Kept:
    """An answer: its status, its header Location, and its body."""

    status: int
    location: str
    body: str
