"""The SQL of Idempotency-Keys."""

from datetime import datetime

from sqlalchemy import delete

from service.errors import IdempotencyKeyReusedError
from service.http.idempotency.keys import Claim, Kept
from service.storage.database import ReadSession, WriteSession
from service.storage.tables import IdempotencyKeyRow


def answer_to(session: ReadSession, claim: Claim, now: datetime) -> Kept | None:
    """Return the answer to the first request with the key; None if there is none, or it has expired.

    Raises
    ------
    IdempotencyKeyReusedError
        That request had another payload.
    """
    row = session.get(IdempotencyKeyRow, (claim.collection, claim.scope, claim.key))
    if row is None or row.expires_at <= now:
        return None
    if row.payload != claim.payload:
        raise IdempotencyKeyReusedError(
            "the Idempotency-Key has come with another file or other fields before"
        )
    return Kept(row.status, row.location, row.body)


def keep(session: WriteSession, claim: Claim, kept: Kept, now: datetime) -> None:
    """Keep the answer to a request, and drop those that have expired."""
    session.execute(delete(IdempotencyKeyRow).where(IdempotencyKeyRow.expires_at <= now))
    session.add(
        IdempotencyKeyRow(
            collection_number=claim.collection,
            scope=claim.scope,
            key=claim.key,
            payload=claim.payload,
            status=kept.status,
            location=kept.location,
            body=kept.body,
            expires_at=claim.expires_at,
        )
    )
