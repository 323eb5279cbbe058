"""The report of a query as one HTML page, without scripts and external files, with pictures from previews.

The page is the template `report.html`; every value is escaped before it is put in.
"""

import json
import struct
from base64 import b64encode
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from html import escape
from importlib.resources import files
from string import Template

import numpy as np

from core.arrays import Floats
from core.io import FORMATS, read_mesh
from core.mesh.mesh import Mesh
from service.client import Client
from service.rendering.colours import colours_of_points
from service.rendering.thumbnail import draw, draw_painted, upright
from service.search.schemas import CC_OF_PAIRS, Pair, QueryAnswer, Result, likeness_in_words, score_in_words
from service.shapes.schemas import box_in_words, number_in_words, volume_in_words
from service.system.schemas import Version

SCORES = {
    "CC": "The correlation of the matched points’ spectral coordinates: 1 for the same shape in any pose. "
    f"{CC_OF_PAIRS}",
    "SSD": "The root of the sum of squared differences of those coordinates, divided by the number of "
    "pairs: 0 for the same shape, and larger for less similar shapes.",
    "sim": "The share of points, from 0 to 1, whose partner on the other shape a smooth map explains.",
    "combined": "The probability, from 0 to 1, that both shapes are of one class, from CC and sim, their "
    "spectra, their global descriptors and their spin images.",
}
PART_DISTANCE = (
    "The distance between the spin images at points of the query and the nearest spin images of the shape: "
    "0 or more; only its order among shapes has a meaning."
)


SIZE = 256
"""Pixels on each side of a picture."""

_GLB = "glb"
# The offsets of the length of the JSON, after the header of the file, and of the JSON itself.
_LENGTH, _JSON = 12, 20


@dataclass(frozen=True, eq=False)
class Preview:
    """The preview of a shape by the service.

    Attributes
    ----------
    mesh : Mesh
        With y up and coordinates in [-1, 1].
    placing : float64, shape (3, 4)
        Maps a point (x, y, z, 1) of the file to the mesh.
    """

    mesh: Mesh
    placing: Floats

    @classmethod
    def of(cls, glb: bytes, format: str) -> "Preview":
        """Read a preview from its GLB and the format of the original file."""
        (length,) = struct.unpack_from("<I", glb, _LENGTH)
        (node,) = json.loads(glb[_JSON : _JSON + length])["nodes"]
        middle, half = np.array(node["extras"]["middle"]), float(node["extras"]["half"])
        turn = FORMATS[_GLB].millimetres * upright(format) / half
        return cls(read_mesh(glb, _GLB), np.hstack([turn, -(turn @ middle)[:, None]]))

    def placed(self, points: Floats) -> Floats:
        """Points of the file, shape (p, 3), in the frame of the mesh."""
        return np.asarray(points @ self.placing[:, :3].T + self.placing[:, 3])

    def in_frame_of(self, first: "Preview", transform: list[list[float]], *, mirrored: bool) -> "Preview":
        """Return the preview as it stands in the frame of a first one, by a transform of their files.

        A mirror image is `mirrored` left for right, so that it is not seen as the first.
        """
        side = np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0])
        placing = side @ first.placing @ np.array(transform)
        points = (self.mesh.vertices - self.placing[:, 3]) @ np.linalg.inv(self.placing[:, :3]).T
        faces = self.mesh.faces if np.linalg.det(placing[:, :3]) > 0.0 else self.mesh.faces[:, ::-1]
        return Preview(Mesh(points @ placing[:, :3].T + placing[:, 3], faces), placing)


def matched(first: Preview, second: Preview, pairs: list[Pair]) -> tuple[bytes, bytes]:
    """Return a PNG of each of two shapes; corresponding points have one colour."""
    ends = (
        first.placed(np.array([pair.first.position for pair in pairs])),
        second.placed(np.array([pair.second.position for pair in pairs])),
    )
    colours = colours_of_points(ends[0], np.eye(3))
    return (
        draw_painted(first.mesh, _GLB, SIZE, ends[0], colours),
        draw_painted(second.mesh, _GLB, SIZE, ends[1], colours),
    )


def page(
    file: tuple[str, str],
    picture: bytes,
    options: Mapping[str, object],
    answer: QueryAnswer,
    matches: Sequence[tuple[bytes, bytes]],
    version: Version,
) -> str:
    """Return the report as a page. The same report always gives the same text.

    `file` is the name of the query's file and its SHA-256, and `picture` a PNG of it. `matches` has for each
    result a PNG of the query and one of the shape, in colours of corresponding points.
    """
    name = escape(file[0])
    results = zip(answer.found, matches, strict=True)
    is_partial = any(result.part_distance is not None for result in answer.found)
    scores = {**SCORES, "part distance": PART_DISTANCE} if is_partial else SCORES
    given = {key: _written(value) for key, value in options.items() if value not in (None, [])}
    made = {
        "file": file[0],
        "SHA-256": file[1],
        "pipeline": f"{version.pipeline}, {answer.pipeline}",
        "service": f"{version.service} {version.version}, method {version.method}",
    }
    template = Template(files("service").joinpath("report.html").read_text(encoding="utf-8"))
    return template.substitute(
        title=f"Most similar to {name}",
        summary="\n".join(f"<p>{escape(line)}</p>" for line in _summary(answer)),
        picture=_picture(picture, "The query"),
        query=name,
        results="\n".join(_section(result, *pictures, file[0]) for result, pictures in results),
        scores="\n".join(f"<dt>{score}</dt><dd>{text}</dd>" for score, text in scores.items()),
        asked=_table("Parameters", [*given.items(), *made.items()]),
    )


def _summary(answer: QueryAnswer) -> list[str]:
    lines = [f"Compared with {answer.compared} of {answer.stored} stored shapes."]
    if not answer.found:
        lines.append("No shape is among the results.")
    elif not (answer.matched or answer.ranked_by == "part_distance"):
        lines.append("No shape is similar to the query. The nearest shapes follow.")
    return lines + answer.warnings


def _section(result: Result, of_query: bytes, of_shape: bytes, query: str) -> str:
    shape = result.shape
    name = escape(shape.name)
    likeness = likeness_in_words(result.likeness, result.scale, result.difference, result.instances)
    pictures = _picture(of_query, f"{query}, coloured") + _picture(of_shape, f"{shape.name}, coloured")
    part = {} if result.part_distance is None else {"part distance": f"{result.part_distance:.4f}"}
    scores = {
        "CC": score_in_words(result.cc),
        "SSD": f"{result.ssd:.4f}",
        "sim": f"{result.sim:.4f}",
        "combined": f"{result.combined:.3f}",
        **part,
    }
    facts = {
        "tags": ", ".join(shape.tags),
        "metadata": _written(shape.metadata) if shape.metadata else "",
        "vertices, faces": f"{shape.facts.vertices}, {shape.facts.faces}",
        "unit": shape.unit or "not stated",
        "length × width × height": box_in_words(shape.facts),
        "area": number_in_words(shape.facts.area),
        "volume": volume_in_words(shape.facts),
        "size over query": "" if result.size_ratio is None else number_in_words(result.size_ratio),
        "warnings": " ".join(shape.warnings),
        "id": shape.id,
    }
    return "\n".join(
        [
            f'<section aria-label="Result {result.rank}">',
            f"<h2>{result.rank}. {name}</h2>",
            f'<figure class="pair">{pictures}',
            f"<figcaption>{escape(query)} and {name}: corresponding points have one colour.</figcaption>",
            "</figure>",
            f"<p><strong>{escape(likeness)}</strong></p>",
            _table("Scores", scores.items(), numbers=True),
            _table("The shape", ((key, value) for key, value in facts.items() if value)),
            "</section>",
        ]
    )


def _written(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _table(caption: str, rows: Iterable[tuple[str, str]], *, numbers: bool = False) -> str:
    kind = ' class="numbers"' if numbers else ""
    cells = [f'<tr><th scope="row">{escape(name)}</th><td>{escape(value)}</td></tr>' for name, value in rows]
    return "\n".join([f"<table{kind}>", f"<caption>{caption}</caption>", *cells, "</table>"])


def _picture(png: bytes, text: str) -> str:
    data = b64encode(png).decode("ascii")
    return f'<img src="data:image/png;base64,{data}" width="256" height="256" alt="{escape(text)}">'


def report(
    client: Client,
    file: tuple[str, bytes],
    options: Mapping[str, object],
    answer: QueryAnswer,
    drawn: Callable[[], object],
) -> str:
    """Return the page of a query (name and bytes) and its answer; call `drawn` after each result is drawn.

    Raise ClientError if a shape or the service is gone, and ValueError if the answer has no correspondences.
    """
    name, data = file
    # The service has read the file; its ending tells which axis is up.
    query = Preview.of(client.preview_file(file), name.rpartition(".")[2].lower())
    matches = []
    for result in answer.found:
        if result.correspondence is None:
            raise ValueError("the answer has no correspondences")
        shape = Preview.of(client.preview(result.shape.id), result.shape.format)
        if result.transform is not None:
            shape = shape.in_frame_of(query, result.transform, mirrored=result.likeness == "mirrored")
        matches.append(matched(query, shape, result.correspondence))
        drawn()
    picture = draw(query.mesh, _GLB, SIZE)
    digest = sha256(data).hexdigest()
    return page((name, digest), picture, options, answer, matches, client.version())
