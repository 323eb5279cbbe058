"""`isoshape demo`: the whole path, on shapes made by code."""

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Annotated

import typer
from PIL import Image, ImageDraw, ImageFont

from core.gallery import CLASSES, make_shape
from core.io import write_mesh
from service.cli.archives import bring_up
from service.cli.serve import compile_with_bar
from service.cli.service_address import Key
from service.client import Client
from service.client.clients import Item, upload_all
from service.compute.compilation import is_compiled
from service.console import fail, output, progress, say, table
from service.report import SIZE, Preview, matched
from service.search.schemas import QueryAnswer, score_in_words
from service.server.process import (
    DEFAULT_PORT,
    LOOPBACK,
    ChildService,
    PortError,
    bind,
    sigterm_exits,
    wait_until_ready,
)
from service.settings import load_parameters, load_settings

POSES = 8
FOLDER = Path("isoshape-data")
MADE = "gallery"

DRAWN = ("person", "quadruped", "hand", "octopus", "plane")
"""The classes with a row in the picture."""

CAPTION_PIXELS = 24
"""The height of the line under each shape of the picture."""


@dataclass(frozen=True)
class Answered:
    """The answer to a query with a made shape of a known class."""

    label: str
    name: str
    answer: QueryAnswer

    @property
    def right(self) -> bool:
        """Whether the first result is of the query's class."""
        return bool(self.answer.results) and self.label in self.answer.results[0].shape.tags


def demo_command(
    *,
    check: Annotated[
        bool,
        typer.Option(
            "--check", help="Fail unless every nearest neighbour is of the query's class, and end then."
        ),
    ] = False,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the service.")] = DEFAULT_PORT,
    picture: Annotated[
        Path | None, typer.Option(help="Write a picture of some answers, corresponding places in one colour.")
    ] = None,
    key: Key = None,
) -> None:
    """Make shapes, store them and query them with unseen poses.

    The shapes are an articulated gallery. The service runs until Ctrl-C, on a database of its own in
    isoshape-data; with --check it ends after the queries.
    """
    try:
        bind(LOOPBACK, port).close()
    except PortError as error:
        fail(f"{error}; choose another with --port", status=2)
    try:
        _run(port, picture, key, check=check)
    except KeyboardInterrupt:
        say("stopped")


def _run(port: int, picture: Path | None, key: str | None, *, check: bool) -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    url = f"sqlite:///{FOLDER / 'demo.sqlite3'}"
    parameters = load_parameters(load_settings().pipeline)
    if not is_compiled(parameters):
        compile_with_bar(parameters)
    bring_up(load_settings().model_copy(update={"database_url": url}))
    settings = {"ISOSHAPE_DATABASE_URL": url}
    if "ISOSHAPE_LOG_LEVEL" not in os.environ:
        settings["ISOSHAPE_LOG_LEVEL"] = "warning"
    with sigterm_exits(), ChildService(port, settings) as child, Client(child.url, key=key) as client:
        first = [_shape(label, 0) for label in CLASSES]
        wait_until_ready(client, child.ended)
        _store(client, first)
        answered = [_query(client, label) for label in CLASSES]
        _print(answered)
        wrong = [query.name for query in answered if not query.right]
        if picture is not None:
            _draw(client, [query for query in answered if query.label in DRAWN], picture)
        say(f"{len(answered) - len(wrong)} of {len(answered)} first neighbours are of the query's class")
        if check:
            if wrong:
                fail(f"the first neighbour is of another class for {', '.join(wrong)}")
            return
        name, data = _shape(CLASSES[0], POSES)
        (FOLDER / name).write_bytes(data)
        _offer(child, FOLDER / name, needs_key=key is not None)


def _name(label: str, pose: int) -> str:
    return f"{label}-{pose:02d}.ply"


def _shape(label: str, pose: int) -> tuple[str, bytes]:
    return _name(label, pose), write_mesh(make_shape(label, pose), "ply")


def _store(client: Client, first: Sequence[tuple[str, bytes]]) -> None:
    """Store the shapes of the gallery that are not stored, and delete those of another gallery.

    Of a class whose `first` shape is stored with the same bytes, only missing shapes are made.
    """
    shapes = list(client.shapes(tag=[MADE]))
    stored = {shape.name: shape for shape in shapes}
    items, kept = [], set()
    with progress() as bar:
        for label, (name, data) in zip(bar.track(CLASSES, description="making shapes"), first, strict=True):
            is_same = name in stored and stored[name].sha256 == sha256(data).hexdigest()
            for pose in range(POSES):
                if is_same and _name(label, pose) in stored:
                    kept.add(stored[_name(label, pose)].id)
                else:
                    items.append(Item(*_shape(label, pose), tags=(label, MADE)))
        task = bar.add_task("storing", total=len(items))
        for item, outcome in upload_all(client, items):
            if isinstance(outcome, str):
                fail(f"{item.origin}: {outcome}")
            kept.add(outcome.shape.id)
            bar.advance(task)
    for shape in shapes:
        if shape.id not in kept:
            client.delete(shape.id)


def _query(client: Client, label: str) -> Answered:
    name, data = _shape(label, POSES)
    return Answered(label, name, client.query_file((name, data), top_k=3, correspondences=True))


def _print(answered: list[Answered]) -> None:
    columns = ("query", ">rank", "stored shape", ">CC", ">SSD", ">sim", "class")
    answers = table(*columns, title="the three stored shapes most similar to an unseen pose")
    for query in answered:
        for result in query.answer.results:
            answers.add_row(
                query.name if result.rank == 1 else "",
                str(result.rank),
                result.shape.name,
                score_in_words(result.cc),
                f"{result.ssd:.4f}",
                f"{result.sim:.4f}",
                "same" if query.label in result.shape.tags else "other",
                end_section=result.rank == len(query.answer.results),
            )
    output().print(answers)


def _draw(client: Client, answered: Sequence[Answered], path: Path) -> None:
    """Write a PNG with a row for each query: the query, then the shapes found, captioned."""
    rows = [list(_pictures(client, query)) for query in answered]
    columns = max(map(len, rows))
    picture = Image.new("RGB", (columns * SIZE, len(rows) * (SIZE + CAPTION_PIXELS)), "white")
    write, font = ImageDraw.Draw(picture), ImageFont.load_default(14)
    for i, row in enumerate(rows):
        for j, (caption, png) in enumerate(row):
            left, top = j * SIZE, i * (SIZE + CAPTION_PIXELS)
            drawn = Image.open(BytesIO(png)).convert("RGBA")
            picture.paste(drawn, (left, top), drawn)
            write.text((left + SIZE // 2, top + SIZE), caption, fill="black", font=font, anchor="ma")
    path.parent.mkdir(parents=True, exist_ok=True)
    picture.save(path, "PNG")


def _pictures(client: Client, query: Answered) -> Iterator[tuple[str, bytes]]:
    """Yield the caption and the picture of a query and of each shape found."""
    first = Preview.of(client.preview_file(_shape(query.label, POSES)), "ply")
    for result in query.answer.results:
        second = Preview.of(client.preview(result.shape.id), result.shape.format)
        pictures = matched(first, second, result.correspondence or [])
        if result.rank == 1:
            yield f"query: {query.name.removesuffix('.ply')}", pictures[0]
        yield f"{result.rank}. {result.shape.name.removesuffix('.ply')}  CC {result.cc:.3f}", pictures[1]


def _offer(child: ChildService, query: Path, *, needs_key: bool) -> None:
    say(f"The service runs until Ctrl-C. Its page: {child.url}/. Its documentation: {child.url}/docs. Try:")
    header = '-H "X-API-Key: $ISOSHAPE_API_KEY" ' if needs_key else ""
    output().print(f"curl {header}-F file=@{query} {child.url}/query", soft_wrap=True)
    with suppress(KeyboardInterrupt):
        fail(f"the service ended with status {child.wait()}")
