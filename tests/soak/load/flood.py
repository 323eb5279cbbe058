"""A process of clients with one key that repeat a request without a pause, until its standard input ends."""

import json
import os
import sys
import threading
from collections import Counter
from pathlib import Path
from typing import Any

import httpx

CLIENTS = 64


def flood(url: str, key: str, method: str, path: str, body: dict[str, Any], answers: Counter[str]) -> None:
    """Repeat a request, and count the answers by their status."""
    with httpx.Client(base_url=url, headers={"X-API-Key": key}, timeout=600) as client:
        while True:
            try:
                status = str(client.request(method, path, **body).status_code)
            except httpx.TransportError as error:
                status = type(error).__name__
            answers[status] += 1


def main() -> None:
    """Flood a service, told its URL, a key, a method, a path, and a file or JSON to send or an empty text."""
    url, key, method, path, content = sys.argv[1:]
    # The clients stand for those of other machines, which take no time of the service.
    os.nice(19)
    body: dict[str, Any] = {}
    if content.startswith("{"):
        body = {"json": json.loads(content)}
    elif content:
        body = {"files": {"file": (Path(content).name, Path(content).read_bytes())}}
    answers: Counter[str] = Counter()
    for _ in range(CLIENTS):
        threading.Thread(target=flood, args=(url, key, method, path, body, answers), daemon=True).start()
    sys.stdin.read()
    print(json.dumps(answers), flush=True)


if __name__ == "__main__":
    main()
