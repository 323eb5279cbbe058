"""A folder of many files as a source: its first scan, a scan of nothing new, and kinds of changes.

    python -m tests.studies.library --files 100000 --distinct 53 library.csv

Equal files are hard links of one another, so that the study measures scans and not embeddings. A row has the
seconds of a scan, its counts, the files by state after it, and the largest memory of the process so far.
"""

import argparse
import csv
import os
import resource
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from service.sources import reading
from service.sources.walk import IGNORE
from service.storage.in_place import open_beneath
from tests.service.support import Running, serving, settings_in, small_file

IN_A_FOLDER = 200
CHANGES = 100
"""Changes of each kind."""

Change = Callable[[list[Path]], object]


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("out", type=Path, help="the CSV file to write")
    parser.add_argument("--files", type=int, default=100_000)
    parser.add_argument("--distinct", type=int, default=53)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="library-", dir=options.out.resolve().parent))
    try:
        rows = list(study(folder, options.files, options.distinct))
    finally:
        shutil.rmtree(folder)
    with options.out.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def study(folder: Path, files: int, distinct: int) -> Iterator[dict[str, Any]]:
    """Yield a row for each scan."""
    root = folder / "models"
    paths = make_tree(root, files, distinct)
    settings = settings_in(folder, source_roots=(str(folder),), undo_days=7.0)
    with serving(settings) as running:
        source = Source(running, root)
        yield source.scan("first scan", added=True)
        yield source.scan("nothing new")
        for kind, change in changes(root).items():
            # Files are taken from the whole tree, others for each kind.
            chosen, paths = paths[:CHANGES], paths[CHANGES:]
            change(chosen)
            yield source.scan(kind)
            if kind == "unreadable":
                reading.open_beneath = open_beneath
        root.rename(folder / "away")
        yield source.scan("mount gone")
        root.mkdir()
        yield source.scan("mount empty")
        root.rmdir()
        (folder / "away").rename(root)
        yield source.scan("mount back")


class Source:
    """The source of a running service."""

    def __init__(self, running: Running, root: Path) -> None:
        self._client, self._root = running.client, root
        self._id = ""

    def scan(self, kind: str, *, added: bool = False) -> dict[str, Any]:
        """Scan the folder; the row of the study."""
        start = time.monotonic()
        if added:
            self._id = self._client.post("/sources", json={"path": str(self._root)}).json()["id"]
        else:
            self._client.post(f"/sources/{self._id}/rescan")
        while (source := self._read())["state"] not in {"ready", "offline"}:
            time.sleep(0.5)
        seconds = time.monotonic() - start
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        scan = source["scan"]
        counts = {name: scan[name] for name in ("found", "stored", "copies", "changed", "moved", "refused")}
        row = {"kind": kind, "state": source["state"], "seconds": round(seconds, 2), **counts}
        row |= {f"now {name}": count for name, count in source["counts"].items()}
        row |= {"shapes": self._client.get("/shapes").json()["total"], "MiB": memory}
        print(row, flush=True)
        return row

    def _read(self) -> dict[str, Any]:
        return dict(self._client.get(f"/sources/{self._id}").json())


def make_tree(root: Path, files: int, distinct: int) -> list[Path]:
    """Make the files as hard links of some distinct ones; return paths of links, a folder's far apart."""
    paths = [root / f"{n // IN_A_FOLDER:04}" / f"part {n}.off" for n in range(files)]
    for folder in {path.parent for path in paths}:
        folder.mkdir(parents=True)
    for number, path in enumerate(paths):
        if number < distinct:
            written(path, small_file(number))
        else:
            os.link(paths[number % distinct], path)
    return [path for start in range(IN_A_FOLDER) for path in paths[start + distinct :: IN_A_FOLDER]]


def written(path: Path, data: bytes) -> None:
    """Write a file as one that has been there for long."""
    path.write_bytes(data)
    os.utime(path, (1_700_000_000, 1_700_000_000))


def changes(root: Path) -> dict[str, Change]:
    """Return the changes of each kind, but for those of the whole folder."""
    other = root / "other"
    other.mkdir()

    def edit(path: Path) -> None:
        # An editor that writes another file and renames it.
        written(path.with_suffix(".new"), small_file(1_000 + int(path.stem.rpartition(" ")[2])))
        path.with_suffix(".new").rename(path)

    def replace(paths: list[Path]) -> None:
        for path, by in zip(paths[::2], paths[1::2], strict=True):
            by.rename(path)

    def forbid(paths: list[Path]) -> None:
        # Root may read everything, so that the system's answer is made.
        forbidden = {path.relative_to(root).as_posix() for path in paths}
        for path in paths:
            written(path.with_suffix(".new"), small_file(9))
            path.with_suffix(".new").rename(path)
            os.utime(path, (1_600_000_000, 1_600_000_000))

        def refuse(folder: Path, path: str) -> int:
            if path in forbidden:
                raise PermissionError(13, "Permission denied")
            return open_beneath(folder, path)

        reading.open_beneath = refuse

    def each(change: Callable[[Path], object]) -> Change:
        return lambda paths: [change(path) for path in paths]

    return {
        "moved": each(lambda path: path.rename(other / path.name)),
        "renamed": each(lambda path: path.rename(path.with_name(f"renamed {path.name}"))),
        "edited": each(edit),
        "deleted": each(lambda path: path.unlink()),
        "replaced": replace,
        "linked": each(lambda path: (other / f"link {path.name}").symlink_to(path)),
        "case changed": each(lambda path: path.rename(path.with_name(path.name.upper()))),
        "unreadable": forbid,
        "left out": lambda paths: (root / IGNORE).write_text(
            "".join(f"/{path.relative_to(root)}\n" for path in paths)
        ),
    }


if __name__ == "__main__":
    main()
