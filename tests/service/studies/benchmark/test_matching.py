"""One match: what is measured of it, in which order, and what the figures are made of."""

import numpy as np
import pytest

from core.gallery import make_shape
from service.studies.benchmark import matching, page
from service.studies.benchmark.functional_maps import SPECTRUM, Peer, functional_maps
from service.studies.benchmark.matching import MANY, PARTS, chain, matching_rows
from service.studies.benchmark.meshes import NEAR, Source
from tests.core.shapes import icosphere


@pytest.fixture(scope="module")
def source():
    """Two classes of two shapes."""
    return Source(
        {
            label: [(f"{label} {pose}", make_shape(label, pose)) for pose in range(2)]
            for label in ("pliers", "cup")
        }
    )


def test_neighbours_of_the_chain_are_of_one_class_and_of_two_by_turns():
    balls = [(f"ball {level}", icosphere(level)) for level in (1, 2, 3)]
    others = [(f"other {level}", icosphere(level)) for level in (4, 3)]
    found = chain(Source({"lone": balls[:1], "ball": balls, "other": others}), 600, 4)
    assert [name for name, _ in found] == ["ball 3", "ball 2", "other 3", "other 4"]
    assert all(abs(len(mesh.vertices) - 600) <= NEAR * 600 for _, mesh in found)
    assert [name for name, _ in chain(Source({"other": others}), 600, 1)] == ["other 3"]


def test_a_source_without_two_of_a_class_gives_no_row():
    assert matching_rows(Source({"ball": [("ball", icosphere(2))]}), None, repeats=1, matches=1) == []


def test_every_pair_is_measured_as_often_as_asked(source):
    rows = matching_rows(source, None, vertices=900, pairs=2, repeats=2, matches=3)
    assert [(row.first.split()[0], row.second.split()[0]) for row in rows] in (
        [("pliers", "pliers"), ("pliers", "cup")],
        [("cup", "cup"), ("cup", "pliers")],
    )
    for row in rows:
        spreads = [row.many, row.reranked, row.coarse, row.score, row.records, *row.parts.values()]
        assert [spread.count for spread in spreads] == [6] * len(spreads)
        assert tuple(row.parts) == PARTS
        assert all(abs(vertices - 900) <= NEAR * 900 for vertices in row.vertices)
        assert row.peer is None
    text = page.page(page.BenchmarkResults(match=rows), "isoshape benchmark", picture=False)
    assert rows[1].many.milliseconds(3) in text
    assert "yfmaps" not in text
    assert page.BenchmarkResults(match=rows).as_json()["match"][0]["vertices"] == rows[0].vertices


def test_the_figures_by_a_clock_that_counts_its_readings(source, monkeypatch):
    """Whatever is between two readings takes a second."""
    readings = iter(range(10**6))
    monkeypatch.setattr(matching, "perf_counter", lambda: float(next(readings)))
    met = []

    def match(first, second):
        met.append((first, second))
        # The first turn, which is not counted, is slower.
        return {"fit": 20.0, "refine": 10.0} if len(met) > 1 else {"fit": 2e6, "refine": 1e6}

    (row,) = matching_rows(
        source, Peer(lambda mesh: len(mesh.vertices), match), vertices=900, pairs=1, repeats=2, matches=2
    )
    assert met == [row.vertices] * 3
    assert (row.score.median, row.records.median) == (1.0, 3.0)
    assert row.many.median == row.reranked.median == row.coarse.median == 1.0 / MANY
    assert {part: spread.median for part, spread in row.parts.items()} == dict.fromkeys(PARTS, 1.0)
    peer = row.peer
    assert {stage: (spread.median, spread.count) for stage, spread in peer.stages.items()} == {
        "fit": (20.0, 2),
        "refine": (10.0, 2),
    }
    assert (peer.match.high, peer.spectra.median, peer.embeddings.median) == (30.0, 1.0, 1.0)
    # 30 to one of 64; 30 to 3; 30 and the spectra to the embedding, packing and the match.
    assert (peer.many.median, peer.records.median) == (30.0 * MANY, 10.0)
    assert peer.meshes.median == pytest.approx(31.0 / 3.0)
    text = page.page(page.BenchmarkResults(match=[row]), "isoshape benchmark", picture=False)
    assert "| 30,000.0 (30,000.0 to 30,000.0) | 20,000.0 (" in text
    assert "| 1,920 (1,920 to 1,920) | 10 (10 to 10) | 10.3 (10.3 to 10.3) |" in text


def test_pyfmaps_on_two_small_meshes():
    meshes = [icosphere(3), make_shape("pliers", 0)]
    before = [mesh.vertices.copy() for mesh in meshes]
    peer = functional_maps()
    first, second = (peer.spectrum(mesh) for mesh in meshes)
    for mesh, vertices in zip(meshes, before, strict=True):
        np.testing.assert_array_equal(mesh.vertices, vertices)
    # The sphere of area 1: l (l + 1) 4 pi, 2 l + 1 times.
    assert len(first.eigenvalues) == SPECTRUM
    expected = 4.0 * np.pi * np.repeat([0.0, 2.0, 6.0], [1, 3, 5])
    np.testing.assert_allclose(first.eigenvalues[:9], expected, rtol=0.03, atol=1e-6)
    stages = peer.match(first, second)
    assert list(stages) == ["descriptors", "fit", "refine"]
    assert min(stages.values()) > 0.0
