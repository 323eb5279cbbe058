"""Makes an archive of a version whose embeddings have no orientation, with that version's own code.

    git worktree add ../before c321ebd
    cp -r tests/service/storage/archives ../before/tests/service/storage/
    cd ../before && OMP_NUM_THREADS=1 python -m tests.service.storage.archives.before_orientation.make

It writes without_orientation.sqlite3, the archive, and without_orientation.json, its answers to queries: a
later version must give the same ones until the archive is reembedded.
"""

import json
import sqlite3
import tempfile
from pathlib import Path

from tests.service.storage.archives.before_views.make import answers
from tests.service.support import serving, settings_in, small_file

HERE = Path(__file__).parent


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        with serving(settings_in(Path(folder), workers=1)) as running:
            for number in range(3):
                running.store(small_file(number), f"{number}.off")
            told = answers(running)
        target = HERE / "without_orientation.sqlite3"
        target.unlink(missing_ok=True)
        with sqlite3.connect(Path(folder) / "archive.sqlite3") as connection:
            connection.execute("VACUUM INTO ?", (str(target),))
        connection.close()
    (HERE / "without_orientation.json").write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
