"""The commands on pairs of shapes: `isoshape compare` and `isoshape duplicates`."""

import json
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Annotated, Literal

import typer

from service.cli.landmarks import read_landmarks, transferred_csv
from service.cli.service_address import Collection, Key, Url, service_at
from service.cli.shapes import shapes_named
from service.client import Client, calls
from service.client.calls import Compared
from service.console import count_of, fail, output, progress, say, table
from service.duplicates.schemas import DuplicatesAnswer
from service.search.compare_schemas import CompareAnswer
from service.search.schemas import likeness_in_words, score_in_words


def compare_command(
    first: Annotated[str, typer.Argument(metavar="A", help="A mesh file, or a stored shape's id or name.")],
    second: Annotated[str, typer.Argument(metavar="B", help="Another one.")],
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
    landmarks: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv",
            help="Points of A by name,x,y,z: print their places on B as CSV. Rows that have x2,y2,z2 too "
            "must correspond.",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer of the service as JSON.")] = False,
    url: Url = None,
    key: Key = None,
    collection: Collection = None,
) -> None:
    """Compare two shapes, vertex by vertex with --out."""
    if picture and out is None:
        fail("--picture writes beside the arrays: give --out FILE.npz", status=2)
    marks = None if landmarks is None else read_landmarks(landmarks)
    with service_at(url, key, collection, new=True) as client:
        pair = _shape(client, first), _shape(client, second)
        if marks is None:
            answer = client.compare(*pair)
        else:
            answer = client.compare(*pair, points=marks.points, landmarks=marks.pairs)
        if out is not None:
            archive = client.send(calls.dense_file(*pair, "npz"))
            out.write_bytes(archive)
            say(f"wrote {out}")
            _say_ambiguous(_maps_in(archive))
            if picture:
                drawn = out.with_suffix(".png")
                drawn.write_bytes(client.send(calls.dense_file(*pair, "png", paint)))
                say(f"wrote {drawn}")
    if as_json:
        typer.echo(json.dumps(answer.model_dump(mode="json", exclude_none=True)))
    elif marks is not None and answer.transferred is not None:
        typer.echo(transferred_csv(marks.names, answer.transferred), nl=False)
        _say_ambiguous(answer.maps or 1)
        say(_line(answer))
    else:
        output().print(_line(answer))


def _maps_in(archive: bytes) -> int:
    """Return the number of maps that an archive of arrays tells."""
    # Not at the top: only --out needs it.
    import numpy as np  # noqa: PLC0415

    with np.load(BytesIO(archive)) as arrays:
        return int(arrays["maps"])


def _say_ambiguous(maps: int) -> None:
    if maps > 1:
        say(f"ambiguous: {maps} maps fit about equally well; landmarks of both shapes tell them apart")


def _shape(client: Client, argument: str) -> Compared:
    """Return a file, if there is one with this name, or else the id of a stored shape."""
    path = Path(argument)
    return path if path.is_file() else shapes_named(client, [argument], "file or shape")[0].id


def _line(answer: CompareAnswer) -> str:
    scores = f"ssd {answer.ssd:.4f}, sim {answer.sim:.4f}, combined {answer.combined:.4f}"
    likeness = likeness_in_words(answer.likeness, answer.scale, answer.difference, answer.instances)
    return f"{likeness}: cc {score_in_words(answer.cc)}, {scores}"


def duplicates_command(
    *,
    max_residual: Annotated[
        float | None,
        typer.Option(help="Largest distance of two aligned surfaces, over the square root of the area."),
    ] = None,
    scaled: Annotated[bool, typer.Option("--scaled", help="Also join copies of other sizes.")] = False,
    mirrored: Annotated[
        bool, typer.Option("--mirrored/--no-mirrored", help="Whether mirror images are copies.")
    ] = True,
    variants: Annotated[
        bool, typer.Option("--variants", help="Also join rigid copies but for a local difference.")
    ] = False,
    decided: Annotated[bool, typer.Option("--decided", help="Also show shapes that are decided.")] = False,
    tag: Annotated[
        list[str] | None, typer.Option(help="Search only shapes with this tag; repeatable.")
    ] = None,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print one row for each shape, as CSV.")] = False,
    xlsx: Annotated[Path | None, typer.Option(help="Write the same rows to this workbook.")] = None,
    url: Url = None,
    key: Key = None,
    collection: Collection = None,
) -> None:
    """Find groups of near-identical stored shapes.

    Copies may be rotated, mirrored or remeshed.
    """
    with service_at(url, key, collection) as client:
        ask = partial(
            client.duplicates,
            max_residual=max_residual,
            scaled=scaled,
            mirrored=mirrored,
            variants=variants,
            decided=decided,
            tag=tag or [],
        )
        answer = ask()
        with progress() as bar:
            total = answer.unjudged
            task = bar.add_task("judging", total=total, visible=bool(total))
            left = total + 1
            while 0 < answer.unjudged < left:
                left = answer.unjudged
                answer = ask(limit=0)
                bar.update(task, completed=total - answer.unjudged)
            unjudged = answer.unjudged
            if total:
                answer = ask(judging_seconds=0.0)
    if unjudged:
        say(f"{count_of(unjudged, 'shape')} cannot be judged now: the groups may be incomplete")
    if xlsx is not None:
        xlsx.write_bytes(answer.xlsx())
    if as_csv:
        typer.echo(answer.csv().replace("\r\n", "\n"), nl=False)
    else:
        _print_groups(answer)
    grouped = sum(len(group) for group in answer.groups)
    groups, aligned = count_of(len(answer.groups), "group"), count_of(answer.aligned, "pair")
    say(f"{grouped} of {count_of(answer.shapes, 'shape')} in {groups}; {aligned} aligned")


def _print_groups(answer: DuplicatesAnswer) -> None:
    columns = (">group", "name", "likeness", ">scale", ">cc of pair", ">residual of pair")
    groups = table(*columns)
    for number, group in enumerate(answer.groups, 1):
        for member in group:
            numbers = f"{member.scale:.4g}", score_in_words(member.cc), f"{member.residual:.4f}"
            groups.add_row(str(number), member.shape.name, member.likeness, *numbers)
    output().print(groups)
    for number, group in enumerate(answer.groups, 1):
        names = {member.shape.id: member.shape.name for member in group}
        for member in group:
            if member.difference is not None:
                other = names.get(member.compared_with or "", member.compared_with)
                first = member.compared_with == group[0].shape.id
                compared = "" if first else f"; compared with {other}"
                line = f"{number} {member.shape.name}: {member.difference.text}{compared}"
                output().print(line, soft_wrap=True)
