"""The header Idempotency-Key: the key of a request, and the keys that are at work.

draft-ietf-httpapi-idempotency-key-header-07: the value is a string of RFC 8941, in double quotes. A key that
comes again with another payload is 422; one whose first request has no answer yet, 409; one that is
malformed, 400. Keys belong to the API key that they come with, and to the collection that the request names,
so that nobody meets another's.
"""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta

from service.collection import CollectionNumber
from service.errors import IdempotencyKeyInFlightError, IdempotencyKeyMalformedError

HEADER = "Idempotency-Key"
REPLAYED = "Idempotency-Replayed"
KEY_CHARACTERS = 255

KEPT_TIME = timedelta(hours=24)
"""How long the answer to a request with a key is kept."""

_STRING = re.compile(r' *"((?:[\x20\x21\x23-\x5b\x5d-\x7e]|\\["\\])*)" *')
_ESCAPED = re.compile(r"\\(.)")


@dataclass(frozen=True)
class Claim:
    """A request with an Idempotency-Key, in the collection that it names.

    `scope` is the digest of the API key of the request, or empty; `payload` is a hash of its form. The answer
    is kept until `expires_at`.
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


def read_key(values: Sequence[str]) -> str | None:
    """Return the key in a request's headers of that name; None where there is none.

    Raise IdempotencyKeyMalformedError if there are several, or it is not 1 to `KEY_CHARACTERS` characters in
    double quotes.
    """
    if not values:
        return None
    quoted = _STRING.fullmatch(values[0])
    if len(values) > 1 or quoted is None:
        raise IdempotencyKeyMalformedError(
            f'{HEADER} must be one string in double quotes, of ASCII characters: {HEADER}: "8e03978e"'
        )
    key = _ESCAPED.sub(r"\1", quoted[1])
    if not 1 <= len(key) <= KEY_CHARACTERS:
        raise IdempotencyKeyMalformedError(
            f"{HEADER} must have 1 to {KEY_CHARACTERS} characters, not {len(key)}"
        )
    return key


def payload_of(sha256: str, filename: str, fields: Mapping[str, Sequence[str]]) -> str:
    """Return a hash of a form: of its file, the file's name and the other fields, however they were sent."""
    text = json.dumps(
        [sha256, filename, {name: list(values) for name, values in fields.items()}], sort_keys=True
    )
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


class InFlight:
    """The keys of the requests at work in this process. It is used in the event loop alone.

    Nothing of this is stored, so a process that dies leaves no key behind that nobody will ever answer.
    """

    def __init__(self) -> None:
        self._keys: set[tuple[int, str, str]] = set()

    @contextmanager
    def taken(self, claim: Claim | None) -> Iterator[None]:
        """Have the key until the end of the block.

        Raise IdempotencyKeyInFlightError if another request has it.
        """
        if claim is None:
            yield
            return
        key = (claim.collection, claim.scope, claim.key)
        if key in self._keys:
            raise IdempotencyKeyInFlightError(f"the first request with the {HEADER} has no answer yet")
        self._keys.add(key)
        try:
            yield
        finally:
            self._keys.remove(key)
