"""The rows of benchmarks, on made shapes, at sizes of which they make light work."""

import subprocess
import sys

import numpy as np
import pytest

from core.descriptors.pieces import COUNT
from core.io import write_mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.serialization import embedding_from_bytes, embedding_to_bytes
from service.evaluation.benchmark_method import (
    MANY,
    Spread,
    digits,
    growth_exponents,
    match_steps,
    matching_rows,
    measure_file,
    neighbours,
)
from service.evaluation.benchmark_service import bound_to, processors
from service.evaluation.benchmark_shapes import NEAR, nearest, read_source, resized, shaken
from tests.core.shapes import icosphere
from tests.gallery import make_shape


def test_a_spread_is_the_quartiles_with_three_digits():
    spread = Spread.of([5.0, 1.0, 2.0, 4.0, 3.0])
    assert (spread.low, spread.median, spread.high, spread.count) == (2.0, 3.0, 4.0, 5)
    assert str(spread) == "3.00 (2.00 to 4.00)"
    assert [digits(value) for value in (1234.5, 45.67, 0.012345, 0.0)] == ["1,234", "45.7", "0.0123", "0"]


def test_the_exponent_of_a_power_is_the_power():
    rows = [
        {"format": "ply", "vertices": size, "seconds": Spread.of([1e-4 * size**1.3]), "peak_bytes": size**0.5}
        for size in (1_000, 20_000, 300_000)
    ]
    assert growth_exponents([*rows, {"format": "stl"}]) == pytest.approx((1.3, 0.5))


@pytest.mark.parametrize("vertices", [100, 642, 5000])
def test_a_surface_is_brought_to_a_size(vertices):
    resized_ball = resized(icosphere(3), vertices)
    assert abs(len(resized_ball.vertices) - vertices) <= NEAR * vertices
    radii = np.linalg.norm(resized_ball.vertices, axis=1)
    assert 0.85 < radii.min() <= radii.max() < 1.15


def test_a_folder_and_made_shapes_give_classes(tmp_path):
    tetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    for folder in ("Fourleg", "Human"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "a.obj").write_text(tetrahedron)
    assert {label: len(meshes) for label, meshes in read_source(tmp_path).items()} == {
        "fourleg": 1,
        "human": 1,
    }
    made = [("large", icosphere(3)), ("small", icosphere(1))]
    assert [name for name, _ in nearest(made, 40, 2)] == ["small", "large"]


def test_a_file_is_embedded_as_often_as_asked(tmp_path):
    path = tmp_path / "ball.ply"
    path.write_bytes(write_mesh(icosphere(3), "ply"))
    seconds, peak = measure_file(str(path), 2)
    assert len(seconds) == 2
    assert peak > 50 * 2**20


def test_neighbours_are_of_one_class_and_of_two_by_turns():
    balls = [(f"ball {level}", icosphere(level)) for level in (1, 2, 3)]
    others = [(f"other {level}", icosphere(level)) for level in (4, 3)]
    entries = neighbours({"lone": balls[:1], "ball": balls, "other": others}, 600, 4)
    assert [name for name, _ in entries] == ["ball 3", "ball 2", "other 3", "other 4"]
    assert all(abs(len(mesh.vertices) - 600) <= NEAR * 600 for _, mesh in entries)
    assert matching_rows({"ball": balls[:1]}, repeats=1) == []


def test_every_step_of_a_match_takes_one_interval_of_a_clock_that_counts_its_readings(monkeypatch):
    readings = iter(range(100))
    monkeypatch.setattr("service.evaluation.benchmark_method.perf_counter", lambda: float(next(readings)))
    method = Pipeline(DEFAULT)
    steps = match_steps(*(method.embed(make_shape("pliers", pose)) for pose in (0, 1)), method)
    shared = dict.fromkeys(("one_of_many", "reranking"), 1.0 / MANY)
    assert {name: step() for name, step in steps.items()} == dict.fromkeys(steps, 1.0) | shared


def test_copies_are_noisy_and_repeatable():
    method = Pipeline(DEFAULT)
    embedding, other = (method.embed(make_shape(label, 0)) for label in ("cup", "pliers"))
    copy = shaken(embedding, 7, other)
    assert copy.signature.tobytes() == shaken(embedding, 7, other).signature.tobytes()
    assert copy.signature.tobytes() != shaken(embedding, 8, other).signature.tobytes()
    assert method.score(embedding, [copy]).cc[0] > method.score(embedding, [other]).cc[0]
    size = (copy.facts.area / embedding.facts.area) ** 0.5
    assert copy.pieces[:, :COUNT] == pytest.approx(size * embedding.pieces[:, :COUNT])
    assert copy.facts.volume / copy.facts.area**1.5 == pytest.approx(
        embedding.facts.volume / embedding.facts.area**1.5
    )
    assert copy.facts.scale / size != pytest.approx(embedding.facts.scale, rel=1e-3)
    assert embedding_to_bytes(copy) == embedding_to_bytes(embedding_from_bytes(embedding_to_bytes(copy)))


def test_the_processors_of_a_process_are_chosen():
    available = processors()
    with bound_to(available[:1]):
        asked = [sys.executable, "-c", "import os; print(len(os.sched_getaffinity(0)))"]
        assert subprocess.run(asked, capture_output=True, check=True).stdout == b"1\n"
    assert processors() == available
