"""A picture of the demo: each query, the stored shapes found and their corresponding points."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from core.gallery import make_shape
from core.io import read_mesh
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import normal_frame
from service.client import Client
from service.rendering.drawing import Panel, draw_grid
from service.search.schemas import QueryAnswer, Result

ROWS = ("person", "quadruped", "hand", "octopus", "plane")


def draw_answers(client: Client, answered: Sequence[tuple[str, QueryAnswer]], path: Path) -> None:
    """Write a PNG: a row for each class of `ROWS`, the query first, then the shapes found."""
    rows = []
    for name, answer in answered:
        label, _, pose = name.removesuffix(".ply").rpartition("-")
        if label in ROWS and answer.results:
            rows.append(_row(client, name, make_shape(label, int(pose)), answer))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(draw_grid(rows))


def _row(client: Client, name: str, query: Mesh, answer: QueryAnswer) -> list[Panel]:
    frame = normal_frame(query)
    panels = []
    for result in answer.results:
        pairs = result.correspondence or []
        along = frame.apply(np.array([pair.first.position for pair in pairs]))[:, 0]
        values = 0.85 * np.argsort(np.argsort(along)) / len(along)
        if result.rank == 1:
            points = np.array([pair.first.position for pair in pairs])
            panels.append(Panel(query, f"query: {name.removesuffix('.ply')}", points, values))
        panels.append(_found(client, result, values))
    return panels


def _found(client: Client, result: Result, values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Panel:
    points = np.array([pair.second.position for pair in result.correspondence or []])
    mesh = read_mesh(client.file(result.shape.id), result.shape.format)
    caption = f"{result.rank}. {result.shape.name.removesuffix('.ply')}  CC {result.cc:.3f}"
    return Panel(mesh, caption, points, values)
