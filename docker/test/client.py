"""Use the service in the container as a client: ``client.py URL fill`` it, later ``client.py URL again``.

Run where the container's network is reached. The environment holds ``ISOSHAPE_API_KEY``.
"""

import json
import os
import sys
import time
from typing import Any

import httpx

from core.gallery import make_shape
from core.io import write_mesh

STORED = [(label, pose) for label in ("octopus", "pliers", "cup") for pose in (0, 1)]
QUERY = ("octopus", 2)


def file_of(label: str, pose: int) -> dict[str, tuple[str, bytes]]:
    """The form's file: a made shape."""
    return {"file": (f"{label}-{pose}.off", write_mesh(make_shape(label, pose), "off"))}


def answer(response: httpx.Response, status: int) -> dict[str, Any]:
    """The body of an answer that must have the status."""
    if response.status_code != status:
        request = f"{response.request.method} {response.url.path}"
        raise SystemExit(f"{request}: {response.status_code}, {response.text}")
    body: dict[str, Any] = response.json()
    return body


def fill(client: httpx.Client) -> None:
    """Upload, query by a pose that is not stored, and query by a stored shape's own file."""
    if answer(client.get("/shapes"), 200)["shapes"]:
        raise SystemExit("the new volume is not empty")
    began = time.monotonic()
    for label, pose in STORED:
        data = {"name": f"{label}-{pose}", "tags": json.dumps([label])}
        answer(client.post("/shapes", files=file_of(label, pose), data=data), 201)
        if (label, pose) == STORED[0]:
            print(f"  first upload answered in {time.monotonic() - began:.1f} s")
    print(f"  {len(STORED)} uploads answered in {time.monotonic() - began:.1f} s")
    again(client)


def again(client: httpx.Client) -> None:
    """Everything that was acknowledged is there, and queries find it."""
    names = {shape["name"] for shape in answer(client.get("/shapes"), 200)["shapes"]}
    if names != {f"{label}-{pose}" for label, pose in STORED}:
        raise SystemExit(f"stored: {sorted(names)}")
    began = time.monotonic()
    results = answer(client.post("/query", files=file_of(*QUERY)), 200)["results"]
    print(f"  a query by a new pose answered in {time.monotonic() - began:.1f} s")
    for result in results:
        cc, ssd, sim = (result[name] for name in ("cc", "ssd", "sim"))
        print(f"    {result['rank']}. {result['shape']['name']:10} cc {cc:.4f}  ssd {ssd:.3g}  sim {sim:.4f}")
    if [result["rank"] for result in results] != [1, 2, 3]:
        raise SystemExit("a query by a new pose did not answer three")
    first = answer(client.post("/query", files=file_of(*STORED[0])), 200)["results"][0]
    exact = (abs(first["cc"] - 1), abs(first["ssd"]), abs(first["sim"] - 1))
    if first["shape"]["name"] != "{}-{}".format(*STORED[0]) or max(exact) > 1e-6:
        raise SystemExit(f"a stored shape's own file does not come back as the same: {first}")


if __name__ == "__main__":
    headers = {"Authorization": f"Bearer {os.environ['ISOSHAPE_API_KEY']}"}
    with httpx.Client(base_url=sys.argv[1], headers=headers, timeout=120) as session:
        {"fill": fill, "again": again}[sys.argv[2]](session)
