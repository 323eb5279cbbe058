"""What the subjects return, on made shapes, at sizes of which they make light work."""

import numpy as np
import pytest

from core.studies.published_figures import TABLE_1, Times
from service.studies.benchmark import growth, page, plot, search_tables, searching
from service.studies.benchmark.embedding import embedding_rows, shapedna
from service.studies.benchmark.growth import growth_rows, measure_file
from service.studies.benchmark.meshes import NEAR, read_source, resized
from service.studies.benchmark.table1 import table1_rows
from service.studies.benchmark.timing import Spread
from tests.core.shapes import icosphere

pytestmark = pytest.mark.studies


@pytest.fixture(scope="module")
def source():
    return read_source(None)


@pytest.fixture(scope="module")
def grown(source, tmp_path_factory):
    return growth_rows(source, tmp_path_factory.mktemp("grown"), sizes=(1000, 4000), repeats=1)


def test_a_spread_is_the_quartiles():
    spread = Spread.of([5.0, 1.0, 2.0, 4.0, 3.0])
    assert (spread.low, spread.median, spread.high, spread.count) == (2.0, 3.0, 4.0, 5)
    assert spread.milliseconds() == "3,000.0 (2,000.0 to 4,000.0)"


@pytest.mark.parametrize("vertices", [100, 642, 2562, 5000])
def test_a_surface_is_brought_to_a_size(vertices):
    ball = icosphere(3)
    found = resized(ball, vertices)
    assert abs(len(found.vertices) - vertices) <= NEAR * vertices
    radii = np.linalg.norm(found.vertices, axis=1)
    assert 0.85 < radii.min() <= radii.max() < 1.15


def test_a_folder_and_made_shapes_give_classes(source, tmp_path):
    (tmp_path / "Fourleg").mkdir()
    (tmp_path / "Human").mkdir()
    for folder in ("Fourleg", "Human"):
        ball = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
        (tmp_path / folder / "a.obj").write_text(ball)
    found = read_source(tmp_path)
    assert [len(found.of(label)) for label in ("fourleg", "human", "fish")] == [1, 1, 0]
    assert len(source.of("fourleg")) == len(source.of("quadruped")) == 3
    assert {line.label for line in TABLE_1 if not source.of(line.label)} == set()


def test_meshes_nearest_to_a_size_come_first(source):
    sizes = [len(mesh.vertices) for _, mesh in source.nearest(3000, 4)]
    assert sizes == sorted(sizes, key=lambda size: abs(size - 3000))
    assert abs(sizes[-1] - 3000) < 400


def test_embedding_beside_lapy(source):
    (row,) = embedding_rows(source, shapedna(), vertices=1000, meshes=1, repeats=2)
    assert row.seconds.count == row.peer.count == row.ratio.count == 2
    assert row.ratio.low <= row.ratio.median <= row.ratio.high
    assert sum(spread.median for spread in row.stages.values()) == pytest.approx(row.seconds.median, rel=0.5)
    text = page.page(page.BenchmarkResults(embedding=[row]), "isoshape benchmark", picture=False)
    assert row.name in text
    assert f"| {row.ratio.median:.2f} (" in text


def test_growth_measures_every_size_and_the_last_in_every_format(grown):
    assert [row.format for row in grown] == ["ply", "ply", "stl", "glb"]
    assert all(
        abs(row.vertices - size) <= NEAR * size for row, size in zip(grown, (1000, 4000), strict=False)
    )
    assert grown[2].vertices == grown[3].vertices == grown[1].vertices
    assert all(row.peak_bytes > 50 * 2**20 for row in grown)


def test_a_file_is_embedded_as_often_as_asked(tmp_path):
    from core.io import write_mesh  # noqa: PLC0415

    path = tmp_path / "ball.ply"
    path.write_bytes(write_mesh(icosphere(3), "ply"))
    found, peak = measure_file(str(path), 2)
    assert len(found) == 2
    assert peak > 50 * 2**20


@pytest.mark.parametrize("power", [0.5, 1.0, 1.3])
def test_the_exponent_of_a_power_is_the_power(grown, power):
    sizes = (1_000, 20_000, 300_000)
    rows = [
        growth.GrowthRow(size, 2 * size, 1, "ply", Spread.of([1e-4 * size**power]), {}, size * size)
        for size in sizes
    ]
    other = growth.GrowthRow(10, 20, 1, "stl", Spread.of([5.0]), {}, 1)
    assert growth.exponents([*rows, other]) == pytest.approx((power, 2.0))


def test_growth_is_a_table_and_a_picture(grown):
    text = page.page(page.BenchmarkResults(growth=grown), "isoshape benchmark", picture=True)
    time, memory = growth.exponents(grown)
    assert f"to the power {time:.2f}, memory to the power {memory:.2f}." in text.replace("\n", " ")
    assert f"]({page.PLOT})" in text
    assert plot.growth_plot(grown).startswith(b"\x89PNG\r\n\x1a\n")


def test_queries_by_size_are_a_table_and_a_picture():
    stages = dict.fromkeys(search_tables.STAGES, 0.01)
    rows = []
    for size, every in ((1_000, False), (10_000, False), (10_000, True), (100_000, False)):
        seconds = 1e-4 * size**0.5
        rows.append(
            searching.SearchRow(size, every, 23, 5.0, 0.1, seconds, 2 * seconds, stages, 100, size * 2**20)
        )
    text = page.page(page.BenchmarkResults(search=rows), "isoshape benchmark", picture=True)
    assert "shapes to the power 0.50, memory to the power 1.00." in text.replace("\n", " ")
    assert f"]({page.SEARCH_PLOT})" in text
    assert plot.search_plot(rows).startswith(b"\x89PNG\r\n\x1a\n")
    alone = page.page(page.BenchmarkResults(search=rows[:1]), "isoshape benchmark", picture=True)
    assert page.SEARCH_PLOT not in alone


def test_a_line_of_table_1(source):
    line = Times("Fishes", "fish", 563, 1.98, 1.22, 2.26)
    none = Times("Dragons", "dragon", 563, 1.98, 1.22, 2.26)
    (row,) = table1_rows(source, lines=[line, none], pairs=1, repeats=1, matches=3)
    assert row.paper is line
    assert abs(row.vertices - 563) <= NEAR * 563
    assert (row.samples, row.points) == (100, 500)
    assert (row.sampling.count, row.embedding.count, row.matching.count) == (2, 2, 3)
    expected = (1.98 / row.sampling.median, 1.22 / row.embedding.median, 2.26 / row.matching.median)
    assert row.faster() == pytest.approx(expected)
    text = page.page(page.BenchmarkResults(table1=[row]), "isoshape benchmark", picture=False)
    assert "Fishes (563)" in text
    assert page.BenchmarkResults(table1=[row]).as_json()["table1"][0]["faster"] == row.faster()
