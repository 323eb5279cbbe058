"""The report as HTML: a query, its results and its options, without scripts and external files."""

import json
from base64 import b64encode
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape

from service.report.style import STYLE
from service.search.schemas import CC_OF_PAIRS, QueryAnswer, Result, likeness_in_words, score_in_words
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


@dataclass(frozen=True)
class PicturedResult:
    """A result with a picture of the query and one of the shape; corresponding points have one colour."""

    result: Result
    query: bytes
    shape: bytes


@dataclass(frozen=True)
class MatchReport:
    """The contents of a report.

    Attributes
    ----------
    name, sha256 : str
        The name and the SHA-256 of the query's file.
    picture : bytes
        A PNG of the query.
    options : mapping
        The options of the query, by the names of the HTTP fields.
    answer : QueryAnswer
    found : tuple of PicturedResult
        The results with their pictures.
    version : Version
        The version of the service.
    """

    name: str
    sha256: str
    picture: bytes
    options: Mapping[str, object]
    answer: QueryAnswer
    found: tuple[PicturedResult, ...]
    version: Version


def page(report: MatchReport) -> str:
    """Return the report as a page. The same report always gives the same text."""
    title = f"Most similar to {escape(report.name)}"
    return "\n".join(
        [
            "<!doctype html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta http-equiv="Content-Security-Policy" '
            "content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\">",
            f"<title>{title}</title>",
            f"<style>\n{STYLE}</style>",
            "</head>",
            "<body>",
            "<main>",
            f"<h1>{title}</h1>",
            *(f"<p>{escape(line)}</p>" for line in _summary(report.answer)),
            f"<figure>{_picture(report.picture, 'The query')}",
            f"<figcaption>The query, {escape(report.name)}</figcaption></figure>",
            *(_section(found, report.name) for found in report.found),
            *_explained(report.answer),
            *_asked(report),
            "</main>",
            "</body>",
            "</html>",
            "",
        ]
    )


def _summary(answer: QueryAnswer) -> list[str]:
    lines = [f"Compared with {answer.compared} of {answer.stored} stored shapes."]
    if not answer.results:
        lines.append("No shape is among the results.")
    elif not (answer.matched or any(result.likeness != "weak" for result in answer.results)):
        lines.append(
            "No shape is similar to the query, by the pipeline’s threshold of CC. The nearest shapes follow."
        )
    return lines + answer.warnings


def _section(found: PicturedResult, query: str) -> str:
    result, shape = found.result, found.result.shape
    name = escape(shape.name)
    pictures = _picture(found.query, f"{query}, coloured") + _picture(found.shape, f"{shape.name}, coloured")
    facts = {
        "tags": ", ".join(shape.tags),
        "metadata": _written(shape.metadata) if shape.metadata else "",
        "vertices, faces": f"{shape.facts.vertices}, {shape.facts.faces}",
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
            f"<p><strong>{escape(likeness_in_words(result.likeness, result.scale))}</strong></p>",
            _table("Scores", _scores(result).items(), numbers=True),
            _table("The shape", ((key, value) for key, value in facts.items() if value)),
            "</section>",
        ]
    )


def _scores(result: Result) -> dict[str, str]:
    part = {} if result.part_distance is None else {"part distance": f"{result.part_distance:.4f}"}
    return {
        "CC": score_in_words(result.cc),
        "SSD": f"{result.ssd:.4f}",
        "sim": f"{result.sim:.4f}",
        "combined": f"{result.combined:.3f}",
        **part,
    }


def _explained(answer: QueryAnswer) -> list[str]:
    partial = any(result.part_distance is not None for result in answer.results)
    scores = {**SCORES, "part distance": PART_DISTANCE} if partial else SCORES
    told = [f"<dt>{name}</dt><dd>{text}</dd>" for name, text in scores.items()]
    return ["<h2>The scores</h2>", "<dl>", *told, "</dl>"]


def _asked(report: MatchReport) -> list[str]:
    given = {name: _written(value) for name, value in report.options.items() if value not in (None, [])}
    version = report.version
    made = {
        "file": report.name,
        "SHA-256": report.sha256,
        "pipeline": f"{version.pipeline}, {report.answer.pipeline}",
        "service": f"{version.service} {version.version}, method {version.method}",
    }
    return ["<h2>The query</h2>", _table("Parameters", [*given.items(), *made.items()])]


def _written(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _table(caption: str, rows: Iterable[tuple[str, str]], *, numbers: bool = False) -> str:
    kind = ' class="numbers"' if numbers else ""
    cells = [f'<tr><th scope="row">{escape(name)}</th><td>{escape(value)}</td></tr>' for name, value in rows]
    return "\n".join([f"<table{kind}>", f"<caption>{caption}</caption>", *cells, "</table>"])


def _picture(png: bytes, text: str) -> str:
    data = b64encode(png).decode("ascii")
    return f'<img src="data:image/png;base64,{data}" width="256" height="256" alt="{escape(text)}">'
