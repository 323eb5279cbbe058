"""Makes an archive of a version whose embeddings have no orientation, with that version's own code.

    git worktree add ../before c321ebd
    cp -r tests/service/storage/archives ../before/tests/service/storage/
    cd ../before && OMP_NUM_THREADS=1 python -m tests.service.storage.archives.before_orientation.make

It writes without_orientation.sqlite3, the archive, and without_orientation.json, its answers to queries: a
later version must give the same ones until the archive is reembedded. The constants of `combined` were fitted
again since: its values are of that code with core/ranking/opinion_pool.py of 67f173f.
"""

from pathlib import Path

from tests.service.storage.archives.before_views.make import write_archive

if __name__ == "__main__":
    write_archive(Path(__file__).with_name("without_orientation.sqlite3"))
