"""`isoshape ablation`: the effect of each step from the paper's setting to the default one."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from core.evaluation.retrieval_measures import Evaluation
from core.parameters import PAPER
from core.studies.ablation import Row, rows, values_of
from service.cli.options import Workers
from service.console import fail, say
from service.datasets import read_collection
from service.studies.pairwise_scores import default_workers
from service.studies.retrieval import Ranking, evaluate_ranking, score_collection
from service.studies.subset import spread

MEASURES = ("nn", "ft", "st")
HEADINGS = {
    "alone": "`paper`, and each change alone",
    "together": "`paper`, and the changes one after another",
    "without": "`default` without each change",
}


@dataclass(frozen=True)
class Finding:
    """A row of the table on one collection."""

    collection: str
    row: Row
    figures: Evaluation

    def as_json(self) -> dict[str, object]:
        """Return the object that `--json` prints."""
        paper = values_of(PAPER)
        return {
            "collection": self.collection,
            "block": self.row.block,
            "row": self.row.title,
            "rank_by": self.row.rank_by,
            "fingerprint": self.row.parameters.fingerprint,
            "changed": {
                name: value
                for name, (group, value) in values_of(self.row.parameters).items()
                if (group, value) != paper[name]
            },
            "shapes": self.figures.shapes,
            "classes": len(self.figures.classes),
            **{name: getattr(self.figures, name) for name in MEASURES},
        }


def ablation_command(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="Folders of meshes with labels.csv, or with a folder a class."),
    ],
    *,
    without: Annotated[
        bool, typer.Option("--without", help="Also measure the default setting without each change.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON list of objects.")] = False,
    limit: Annotated[
        int | None,
        typer.Option(min=2, help="Use only this many shapes of each folder, spread over the classes."),
    ] = None,
    workers: Workers = None,
) -> None:
    """Measure retrieval after each change to the paper's setting.

    The output is a Markdown table of NN (nearest neighbour), FT and ST (first and second tier), measured as
    by `isoshape evaluate`. A folder takes about twenty evaluations.
    """
    collections = [(folder.resolve().name, read_collection(folder)) for folder in folders]
    wanted = rows(without=without)
    findings: list[Finding] = []
    short = 0
    for name, files in collections:
        chosen = spread(files, limit) if limit is not None else files
        found, missing = _measure(chosen, wanted, workers or default_workers())
        findings += [Finding(name, row, figures) for row, figures in zip(wanted, found, strict=True)]
        short += missing
    if as_json:
        typer.echo(json.dumps([finding.as_json() for finding in findings]))
    else:
        typer.echo(table(wanted, findings))
    if short:
        fail(f"{short} times a file could not be used")


def table(wanted: tuple[Row, ...], findings: list[Finding]) -> str:
    """One Markdown table for each block, with three columns for each collection."""
    by_row: dict[int, list[Finding]] = {}
    for place, finding in enumerate(findings):
        by_row.setdefault(place % len(wanted), []).append(finding)
    names = [finding.collection for finding in by_row[0]]
    parts: list[str] = []
    for block, heading in HEADINGS.items():
        places = [i for i, row in enumerate(wanted) if row.block == block]
        if not places:
            continue
        lines = [
            f"| {heading} | rank by |" + "".join(f" {name} NN | FT | ST |" for name in names),
            "|---|---|" + "---:|---:|---:|" * len(names),
        ]
        for i in places:
            sign = "" if i == places[0] else "- " if block == "without" else "+ "
            figures = [f"{getattr(one.figures, name):.3f}" for one in by_row[i] for name in MEASURES]
            lines.append(f"| {sign}{wanted[i].title} | {wanted[i].rank_by} | " + " | ".join(figures) + " |")
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


def _measure(
    files: list[tuple[Path, str]], wanted: tuple[Row, ...], workers: int
) -> tuple[list[Evaluation], int]:
    """One evaluation for each row, each set of parameters run once; and the number of files that failed."""
    known: dict[str, dict[Ranking, Evaluation]] = {}
    missing = 0
    for row in wanted:
        if row.parameters.fingerprint not in known:
            say(f"{len(known) + 1} of {len({one.parameters.fingerprint for one in wanted})}: {row.title}")
            labels, scores = score_collection(files, row.parameters, workers)
            missing += len(files) - len(labels)
            known[row.parameters.fingerprint] = {
                ranking: evaluate_ranking(scores, labels, ranking)
                for ranking in (Ranking.CC, Ranking.COMBINED)
            }
    return [known[row.parameters.fingerprint][Ranking(row.rank_by)] for row in wanted], missing
