"""Clients that upload and delete until the service is gone."""

import json
import random
import threading

import httpx

from tests.service.support import small_file
from tests.soak.kill.ledger import Ledger, Sent

KEPT = 24
"""Beyond so many shapes clients delete as well."""

KNOWN = 6
"""Files that every client uploads again and again, under new names: with no embedding to wait for, the
service is mostly in the middle of a write."""


class Load:
    """Some clients, each in a thread.

    Parameters
    ----------
    url : str
    ledger : Ledger
    seed : int
        Of what each client does.
    clients : int
    """

    def __init__(self, url: str, ledger: Ledger, seed: int, clients: int) -> None:
        self._url = url
        self._ledger = ledger
        self._seed = seed
        self.faults: list[str] = []
        self._threads = [threading.Thread(target=self._run, args=(number,)) for number in range(clients)]
        for thread in self._threads:
            thread.start()

    def join(self) -> None:
        """Wait until every client has met the service's end."""
        for thread in self._threads:
            thread.join()

    def _run(self, client: int) -> None:
        draw = random.Random(f"{self._seed} {client}")
        with httpx.Client(base_url=self._url, timeout=60) as http:
            count = 0
            while True:
                try:
                    self._upload(http, draw, f"{self._seed}-{client}-{count}")
                    self._delete(http, draw)
                except httpx.TransportError:
                    return
                except Exception as error:
                    self.faults.append(repr(error))
                    return
                count += 1

    def _upload(self, http: httpx.Client, draw: random.Random, name: str) -> None:
        new = draw.random() < 0.3
        number = draw.randrange(KNOWN, 10**6) if new else draw.randrange(KNOWN)
        sent = Sent(f"{name}.off", small_file.__wrapped__(number), f"tag {number}", {"number": number})
        self._ledger.send(sent)
        fields = {"tags": sent.tag, "metadata": json.dumps(sent.metadata)}
        answer = http.post("/shapes", files={"file": (sent.name, sent.data)}, data=fields)
        if answer.status_code == 201:
            self._ledger.stored(sent.name, answer.json()["id"])
        elif answer.status_code != 503:
            self.faults.append(f"upload: {answer.status_code} {answer.text}")

    def _delete(self, http: httpx.Client, draw: random.Random) -> None:
        shape_id = self._ledger.take(KEPT) if draw.random() < 0.9 else None
        if shape_id is None:
            return
        answer = http.delete(f"/shapes/{shape_id}")
        if answer.status_code == 204:
            self._ledger.deleted(shape_id)
        elif answer.status_code != 503:
            self.faults.append(f"delete: {answer.status_code} {answer.text}")
