"""The requests of one client. Run by locust, in an environment of its own that has nothing of this project.

ISOSHAPE_LOAD_FILES names a folder of meshes, and the file to which the counts are written at the end.
"""

import json
import os
import random
import time
import uuid
from collections import Counter, defaultdict
from pathlib import Path

from locust import HttpUser, between, events, task

FOLDER = Path(os.environ["ISOSHAPE_LOAD_FILES"])
FILES = sorted(FOLDER.glob("*.off"))
KEPT = 20
"""Shapes that each client keeps; beyond, it deletes."""

statuses = defaultdict(Counter)
broken = Counter()


@events.request.add_listener
def count(name, response, exception, **_):
    status = response.status_code if response is not None else 0
    statuses[name][status] += 1
    if exception is not None:
        broken[f"{name}: {exception!r}"] += 1
    elif status >= 500 and not is_back_pressure(response):
        broken[f"{name}: {status} {response.text[:200]}"] += 1


def is_back_pressure(response):
    """Whether the queue was full, and the client was told when to come back."""
    return response.json()["type"] == "urn:isoshape:problem:busy" and "retry-after" in response.headers


@events.quitting.add_listener
def write(environment, **_):
    rows = [
        {
            "request": entry.name,
            "statuses": dict(statuses[entry.name]),
            "median": entry.median_response_time,
            "p95": entry.get_response_time_percentile(0.95),
        }
        for entry in sorted(environment.stats.entries.values(), key=lambda entry: entry.name)
    ]
    (FOLDER / "counts.json").write_text(json.dumps({"rows": rows, "broken": dict(broken)}))


class Client(HttpUser):
    """Keeps some shapes, and asks about them."""

    wait_time = between(0.0, 0.2)

    def on_start(self):
        self.draw = random.Random()
        self.mine = []

    def send(self, method, name, path, **body):
        """A request. Any answer is one, and `count` judges it; whoever is turned away waits as told."""
        with self.client.request(method, path, name=name, catch_response=True, **body) as answer:
            if answer.status_code:
                answer.success()
        if answer.status_code == 503:
            time.sleep(float(answer.headers.get("retry-after", 1)))
        return answer

    def file(self):
        path = self.draw.choice(FILES)
        return {"file": (path.name, path.read_bytes())}

    @task(6)
    def upload(self):
        name = f"{uuid.uuid4()}"
        answer = self.send(
            "POST", "upload", "/shapes", files=self.file(), data={"name": name, "tags": "load"}
        )
        if answer.status_code == 201:
            self.mine.append(answer.json()["id"])
        if len(self.mine) > KEPT:
            shape = self.mine.pop(self.draw.randrange(len(self.mine)))
            if self.send("DELETE", "delete", f"/shapes/{shape}").status_code != 204:
                self.mine.append(shape)

    @task(4)
    def query_by_file(self):
        self.send("POST", "query by file", "/query", files=self.file())

    @task(4)
    def query_by_id(self):
        if self.mine:
            self.send("POST", "query by id", "/query", json={"shape_id": self.draw.choice(self.mine)})

    @task(2)
    def compare(self):
        if self.mine:
            pair = {"first": self.draw.choice(self.mine), "second": self.draw.choice(self.mine)}
            self.send("POST", "compare", "/compare", json=pair)

    @task(3)
    def page(self):
        self.send("GET", "list", "/shapes?limit=50")

    @task(3)
    def look(self):
        if self.mine:
            shape = self.draw.choice(self.mine)
            for part in ("", "/file", "/embedding"):
                self.send("GET", f"shape{part}", f"/shapes/{shape}{part}")

    @task(1)
    def change(self):
        if self.mine:
            body = {"metadata": {"n": self.draw.random()}}
            self.send("PATCH", "change", f"/shapes/{self.draw.choice(self.mine)}", json=body)

    @task(1)
    def bad_upload(self):
        data = self.draw.randbytes(self.draw.randrange(2000))
        self.send("POST", "bad upload", "/shapes", files={"file": ("bad.stl", data)})

    @task(1)
    def probe(self):
        for path in ("/healthz", "/readyz", "/metrics", "/nothing"):
            self.send("GET", path, path)
