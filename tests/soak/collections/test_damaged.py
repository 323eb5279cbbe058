"""Models of the web, and ten damaged copies of each, over HTTP: taken, or refused by name of their fault."""

import re
from pathlib import Path

import numpy as np

from core.io import write_mesh
from service.http.problem_document import TYPE_PREFIX
from tests.core.damaged import DAMAGES
from tests.service.processes import server
from tests.soak.collections.folders import read, sample
from tests.soak.hostile.test_changed import REFUSALS


def test_models_and_damaged_copies_are_taken_or_refused_and_searched(tmp_path: Path) -> None:
    wrong = []
    with server(tmp_path, PYTHONWARNINGS="always::RuntimeWarning") as (_, client):
        for number, (path, _) in enumerate(sample("webmodels")[::6]):
            rng, mesh = np.random.default_rng(number), read(path)
            copies = {name: write_mesh(damage(mesh, rng), "ply") for name, damage in DAMAGES.items()}
            client.post("/shapes", files={"file": (path.name, path.read_bytes())}).raise_for_status()
            for name, copy in copies.items():
                answer = client.post("/shapes", files={"file": (f"{name}.ply", copy)})
                if answer.status_code == 201:
                    client.delete(answer.headers["location"]).raise_for_status()
                elif answer.json()["type"].removeprefix(TYPE_PREFIX) not in REFUSALS:
                    wrong.append(f"{path.name}, {name}: {answer.text}")
            copy = list(copies.values())[number % len(copies)]
            answer = client.post("/query", files={"file": ("copy.ply", copy)}, data={"rank_by": "combined"})
            assert answer.status_code in {200, 422}, answer.text
    log = (tmp_path / "log.txt").read_text().splitlines()
    # Python's warnings have the name of a class.
    wrong += [line for line in log if re.search(r"\wWarning", line) or '"level": "error"' in line]
    assert wrong == []
