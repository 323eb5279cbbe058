"""The sender of webhooks: it looks for what is new, and delivers messages in the form of Standard Webhooks.

An upload writes nothing for them: what is new is read from the archive. A message that is not delivered is
tried again, and what is stored meanwhile comes with the next one.
"""

import asyncio
import base64
import hashlib
import hmac
import time

import httpx

from service.container import Container
from service.errors import ServiceError
from service.observability.logging import get_logger
from service.webhooks import repository
from service.webhooks.repository import ATTEMPTS, Message

LOOK_SECONDS = 5.0
"""Interval at which the sender looks for what is new and for messages that are due."""

ANSWER_SECONDS = 15.0
"""The longest that the receiver of a message may take to answer."""

PAUSE_SECONDS = 60.0

log = get_logger("webhooks")


def headers_of(message: Message, key: bytes, seconds: int) -> dict[str, str]:
    """Return the headers of a message that is sent at a time, in seconds since 1970."""
    signed = hmac.digest(key, f"{message.id}.{seconds}.{message.body}".encode(), hashlib.sha256)
    return {
        "content-type": "application/json",
        "webhook-id": message.id,
        "webhook-timestamp": str(seconds),
        "webhook-signature": f"v1,{base64.b64encode(signed).decode()}",
    }


class Sender:
    """The sender of an archive's messages. `look` is called again and again."""

    def __init__(self, container: Container, client: httpx.AsyncClient) -> None:
        self._database, self._settings = container.database, container.settings
        self._client = client

    async def look(self) -> None:
        """Make the messages of what is new, and deliver those that are due."""
        database = self._database
        latest = await database.reading(repository.latest)
        for row in await database.reading(repository.waiting):
            if row.due_at is None:
                if latest[row.kind] <= row.told:
                    continue
                await database.writing(repository.make, row.kind)
            elif not repository.is_due(row):
                continue
            message = await database.writing(repository.take, row.kind)
            if message is not None and (await self._is_delivered(message) or message.attempts >= ATTEMPTS):
                await database.writing(repository.settle, message)

    async def _is_delivered(self, message: Message) -> bool:
        """Send a message; return whether the receiver answers with success."""
        headers = headers_of(message, self._settings.webhook_key, int(time.time()))
        address, body = self._settings.webhook_url, message.body.encode()
        try:
            # The address may have a secret, and the body of the answer any length: neither is looked at.
            async with (
                asyncio.timeout(ANSWER_SECONDS),
                self._client.stream("POST", address, content=body, headers=headers) as answer,
            ):
                if answer.is_success:
                    return True
                reason = f"it answered {answer.status_code}"
        except (httpx.HTTPError, httpx.InvalidURL, TimeoutError) as error:
            reason = type(error).__name__
        given_up = ", the last" if message.attempts >= ATTEMPTS else ""
        log.warning("a webhook failed in attempt %d%s: %s", message.attempts, given_up, reason)
        return False


async def keep_telling(container: Container) -> None:
    """Tell the address in the settings what is new in the archive, until cancelled."""
    async with httpx.AsyncClient(timeout=ANSWER_SECONDS) as client:
        sender, begun = Sender(container, client), False
        while True:
            try:
                if not begun:
                    await container.database.writing(repository.begin)
                    begun = True
                await sender.look()
                await asyncio.sleep(LOOK_SECONDS)
            except ServiceError as error:
                log.warning("webhooks wait: %s", error)
                await asyncio.sleep(PAUSE_SECONDS)
            except Exception as error:
                log.error("webhooks wait", exc_info=error)
                await asyncio.sleep(PAUSE_SECONDS)
