"""Tags that neighbours suggest, families and the map, against the classes of a collection.

    python -m tests.studies.suggestions DIR [--collection COLLECTION] [--count 240]

Shapes are stored with their classes as tags: those of a labelled folder, or as many machine parts. When all
neighbours are known, each shape in turn loses its tag and is asked for suggestions. Writes suggestions.csv,
families.csv and map.png. Exits with status 1 unless, from each share on, the suggestions are right at least
that often.
"""

import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from core.io import write_mesh
from service.client import Client
from service.client.clients import Item, upload_all
from service.datasets import read_collection
from service.evaluation.benchmark_service import served
from service.shapes.schemas import Shape
from tests.studies.common import run, save, write
from tests.studies.machine_parts import FAMILIES, Drawing, part

SHARES = (0.5, 0.6, 0.7, 0.8, 0.9)
TOLERANCE, DRAWINGS = 0.02, 5000
"""Chord tolerance of the parts in millimetres, and the number of the first drawing."""

WAIT = 1800.0
"""Seconds until the neighbours of all shapes are known, at most."""


def items(collection: Path | None, count: int) -> list[Item]:
    """Return the files of a labelled folder, or those of so many parts, each tagged with its class."""
    if collection is not None:
        labelled = enumerate(read_collection(collection))
        return [
            Item(f"{number} {path.name}", path, (label.casefold(),)) for number, (path, label) in labelled
        ]
    families = [list(FAMILIES)[number % len(FAMILIES)] for number in range(count)]
    return [
        Item(
            f"{family}-{number}.stl",
            write_mesh(part(family, Drawing(DRAWINGS + number, TOLERANCE)), "stl"),
            (family,),
        )
        for number, family in enumerate(families)
    ]


def wait_for_neighbours(client: Client, shapes: Sequence[Shape]) -> float:
    """Return the seconds until the neighbours of all shapes are known; raise TimeoutError after `WAIT`."""
    began = time.monotonic()
    while not all(client.suggestions(shape.id).known for shape in shapes):
        if time.monotonic() > began + WAIT:
            raise TimeoutError(f"some neighbours are not known after {WAIT:.0f} s")
        time.sleep(1.0)
    return time.monotonic() - began


def suggested(client: Client, shapes: Sequence[Shape]) -> list[tuple[float, bool]]:
    """Return the share of each suggestion for a shape without its tag, and whether it is that tag."""
    found = []
    for shape in shapes:
        client.update(shape.id, tags=[])
        answer = client.suggestions(shape.id, least_share=SHARES[0])
        client.update(shape.id, tags=shape.tags)
        found += [(each.share, each.value in shape.tags) for each in answer.suggestions]
    return found


def draw_map(client: Client, class_of: dict[str, str], path: Path) -> None:
    """Draw the similarity map, a colour and a name for each class."""
    figure = Figure(figsize=(8, 8), layout="tight")
    axes = figure.add_subplot()
    positions: dict[str, list[tuple[float, float]]] = {}
    for shape in client.similarity_map().shapes:
        positions.setdefault(class_of[shape.id], []).append((shape.x, shape.y))
    for number, (label, places) in enumerate(sorted(positions.items())):
        x, y = np.array(places).T
        axes.scatter(x, y, s=14, color=colormaps["tab20"](number % 20))
        axes.text(float(np.median(x)), float(np.median(y)), label, fontsize=7)
    axes.set_axis_off()
    save(figure, path)


def main(folder: Path, collection: Path | None, count: int) -> bool:
    """Write the tables and the map; return whether suggestions are right as often as their shares say."""
    with TemporaryDirectory() as scratch:
        archive = f"sqlite:///{scratch}/archive.sqlite3"
        with served(archive, rate_limit=0, duplicates_in_background=True) as (_, client):
            refused = [
                outcome
                for _, outcome in upload_all(client, items(collection, count))
                if isinstance(outcome, str)
            ]
            shapes = list(client.shapes())
            seconds = wait_for_neighbours(client, shapes)
            print(f"{len(shapes)} shapes, {len(refused)} refused; neighbours known after {seconds:.0f} s")
            found = suggested(client, shapes)
            families = client.families().families
            class_of = {shape.id: shape.tags[0] for shape in shapes}
            draw_map(client, class_of, folder / "map.png")
    rows = []
    for share in SHARES:
        right = [is_right for its_share, is_right in found if its_share >= share]
        row = {"share": share, "suggestions": len(right), "precision": float(np.mean(right or [1.0]))}
        rows.append(row | {"recall": sum(right) / len(shapes)})
    write(folder / "suggestions.csv", rows)
    classes = [Counter(class_of[shape.id] for shape in family.shapes).most_common() for family in families]
    write(
        folder / "families.csv",
        [
            {"shapes": sum(number for _, number in counts), "class": counts[0][0], "of_class": counts[0][1]}
            for counts in classes
        ],
    )
    return all(row["precision"] >= row["share"] for row in rows)


if __name__ == "__main__":
    run(main, __doc__, collection=Path, count=240)
