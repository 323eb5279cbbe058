"""Makes the stored archive of a release, with that release's own code.

    git worktree add ../released v0.1.0
    cp -r tests/service/storage/archives ../released/tests/service/storage/
    cd ../released && OMP_NUM_THREADS=1 python -m tests.service.storage.archives.make 0.1.0

It writes VERSION.sqlite3, the archive, and VERSION.json, what the service answered about it: a later version
must open the one and answer the other.
"""

import json
import sqlite3
import sys
import tempfile
from pathlib import Path
from typing import Any

from tests.service.support import Running, serving, settings_in, small_file

HERE = Path(__file__).parent


def answers(running: Running) -> dict[str, Any]:
    """What the service tells of all that it holds, and of itself."""
    shapes = running.client.get("/shapes", params={"limit": 500}).json()["shapes"]
    return {"version": running.client.get("/version").json(), "shapes": shapes}


def fill(running: Running) -> None:
    """Two files under three names, and one that is deleted again: ids, tags, metadata of every kind."""
    running.store(small_file(0), "one.off", tags=["ball", "first"], metadata='{"year": 2024, "by": "us"}')
    gone = running.store(small_file(1), "gone.off")
    running.store(small_file(2, "stl"), "Zwei äöü.stl", tags="ball", metadata='{"nested": {"a": [1, null]}}')
    running.store(small_file(0), "one again.off")
    assert running.client.delete(f"/shapes/{gone['id']}").status_code == 204


def main(version: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        with serving(settings_in(Path(folder), workers=1)) as running:
            fill(running)
            told = answers(running)
        target = HERE / f"{version}.sqlite3"
        target.unlink(missing_ok=True)
        with sqlite3.connect(Path(folder) / "archive.sqlite3") as connection:
            connection.execute("VACUUM INTO ?", (str(target),))
        connection.close()
    text = json.dumps(told, indent=2, ensure_ascii=False)
    (HERE / f"{version}.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
