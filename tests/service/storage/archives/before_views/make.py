"""Makes an archive of a version whose embeddings have no views, with that version's own code.

    git worktree add ../before 722f94e
    cp -r tests/service/storage/archives ../before/tests/service/storage/
    cd ../before && OMP_NUM_THREADS=1 python -m tests.service.storage.archives.before_views.make

It writes without_views.sqlite3, the archive, and without_views.json, its answers to queries: a later version
must give the same ones until the archive is reembedded.
"""

import json
import sqlite3
import tempfile
from pathlib import Path
from typing import Any

from core.gallery import make_shape
from core.io import write_mesh
from core.studies.perturbation import cut_part
from tests.service.support import Running, query, serving, settings_in, small_file

SCORES = ("cc", "ssd", "sim", "combined")


def queries() -> dict[str, bytes]:
    """A complete shape, and a part of one."""
    part = write_mesh(cut_part(make_shape("cup", 0), 0.5, 1), "off")
    return {"small": small_file(20), "part": part}


def answers(running: Running) -> dict[str, Any]:
    """The active pipeline, the results of queries, and the comparison of two shapes."""
    client = running.client
    told = [
        {
            "query": name,
            "rank_by": rank_by,
            "results": [
                {"name": result["shape"]["name"], **{score: result[score] for score in SCORES}}
                for result in query(client, data, rank_by=rank_by, top_k=10).json()["results"]
            ],
        }
        for rank_by in ("cc", "combined")
        for name, data in queries().items()
    ]
    first, second, *_ = [shape["id"] for shape in client.get("/shapes").json()["shapes"]]
    compared = client.post("/compare", json={"first": first, "second": second}).json()
    return {
        "version": client.get("/version").json(),
        "answers": told,
        "compared": {score: compared[score] for score in SCORES},
    }


def write_archive(target: Path) -> None:
    """Writes an archive of three shapes, and beside it, as JSON, its answers."""
    with tempfile.TemporaryDirectory() as folder:
        with serving(settings_in(Path(folder), workers=1)) as running:
            for number in range(3):
                running.store(small_file(number), f"{number}.off")
            told = answers(running)
        target.unlink(missing_ok=True)
        with sqlite3.connect(Path(folder) / "archive.sqlite3") as connection:
            connection.execute("VACUUM INTO ?", (str(target),))
        connection.close()
    target.with_suffix(".json").write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write_archive(Path(__file__).with_name("without_views.sqlite3"))
