"""Times of thumbnails over HTTP: drawn, read from the database, and unchanged for the browser."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import httpx

from core.io import write_mesh
from service.studies.benchmark.meshes import Source, resized
from service.studies.benchmark.searching import served
from service.studies.benchmark.timing import Spread

VERTICES = (1_000, 3_000, 20_000)
MESHES = 7


@dataclass(frozen=True)
class PictureRow:
    """Times of thumbnails of 256 by 256 pixels, for meshes of about one size; seconds.

    Attributes
    ----------
    vertices : int
    drawn : Spread
        The first request, in warm workers.
    kept : Spread
        Later requests.
    unchanged : Spread
        Conditional requests, answered 304.
    size : int
        Size of the largest thumbnail in bytes.
    """

    vertices: int
    drawn: Spread
    kept: Spread
    unchanged: Spread
    size: int


def picture_rows(
    source: Source, folder: Path, *, vertices: Sequence[int] = VERTICES, meshes: int = MESHES
) -> list[PictureRow]:
    """Measure each number of vertices, with an archive in `folder`."""
    rows = []
    url = f"sqlite:///{folder / 'pictures.sqlite3'}"
    with served(url) as (service, client), httpx.Client(base_url=service.url, timeout=600.0) as http:
        for count in vertices:
            drawn, kept, unchanged, size = [], [], [], 0
            for name, mesh in source.nearest(count, meshes + 1):
                data = write_mesh(resized(mesh, count), "ply")
                stored = client.upload((f"{count} {name}.ply", data)).shape
                address = f"/shapes/{stored.id}/thumbnail.png"
                first, picture = _timed(http, address)
                drawn.append(first)
                kept.append(_timed(http, address)[0])
                unchanged.append(_timed(http, address, {"If-None-Match": picture.headers["etag"]})[0])
                size = max(size, len(picture.content))
            # The first request waits until the libraries are loaded.
            rows.append(
                PictureRow(count, Spread.of(drawn[1:]), Spread.of(kept[1:]), Spread.of(unchanged[1:]), size)
            )
    return rows


def picture_table(rows: Sequence[PictureRow]) -> list[list[str]]:
    """A line a number of vertices: milliseconds."""
    return [
        ["vertices", "drawn, ms", "kept, ms", "the browser has it, ms", "bytes at most"],
        *(
            [
                f"{row.vertices:,}",
                row.drawn.milliseconds(),
                row.kept.milliseconds(),
                row.unchanged.milliseconds(),
                f"{row.size:,}",
            ]
            for row in rows
        ),
    ]


def _timed(
    http: httpx.Client, address: str, headers: dict[str, str] | None = None
) -> tuple[float, httpx.Response]:
    before = perf_counter()
    answer = http.get(address, headers=headers)
    seconds = perf_counter() - before
    if answer.status_code != httpx.codes.NOT_MODIFIED:
        answer.raise_for_status()
    return seconds, answer
