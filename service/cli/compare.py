"""`isoshape compare`: two shapes point by point, and where they differ."""

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from service.cli.service_address import Collection, Key, Url, service_at
from service.client import search_calls
from service.client.search_calls import Compared
from service.console import fail, output, say
from service.search.likeness_words import in_words
from service.search.schemas import CompareAnswer
from service.search.score_words import score_in_words


def command(
    first: Annotated[str, typer.Argument(metavar="A", help="A mesh file, or the id of a stored shape.")],
    second: Annotated[str, typer.Argument(metavar="B", help="Another file or id.")],
    *,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE.npz", help="Write the vertex of B for each vertex of A, as arrays."),
    ] = None,
    picture: Annotated[
        bool, typer.Option("--picture", help="Write a picture of both beside the arrays, as FILE.png.")
    ] = False,
    paint: Annotated[
        Literal["correspondence", "difference"],
        typer.Option(help="Colours of the picture: corresponding places alike, or where the two differ."),
    ] = "correspondence",
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer of the service as JSON.")] = False,
    url: Url = None,
    key: Key = None,
    collection: Collection = None,
) -> None:
    """Compare two shapes, vertex by vertex with --out."""
    if picture and out is None:
        fail("--picture writes beside the arrays: give --out FILE.npz", status=2)
    pair = _shape(first), _shape(second)
    with service_at(url, key, collection, new=True) as client:
        answer = client.compare(*pair)
        if out is not None:
            out.write_bytes(client.send(search_calls.dense_file(*pair, "npz")))
            say(f"wrote {out}")
            if picture:
                drawn = out.with_suffix(".png")
                drawn.write_bytes(client.send(search_calls.dense_file(*pair, "png", paint)))
                say(f"wrote {drawn}")
    if as_json:
        typer.echo(json.dumps(answer.model_dump(mode="json", exclude_none=True)))
    else:
        output().print(_line(answer))


def _shape(given: str) -> Compared:
    """A file, if there is one with this name, or else an id."""
    path = Path(given)
    return path if path.is_file() else given


def _line(answer: CompareAnswer) -> str:
    scores = f"ssd {answer.ssd:.4f}, sim {answer.sim:.4f}, combined {answer.combined:.4f}"
    return f"{in_words(answer.likeness, answer.scale)}: cc {score_in_words(answer.cc)}, {scores}"
