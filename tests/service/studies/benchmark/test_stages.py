"""Stages: they add up, they change nothing, and nothing of the watch stays behind."""

import numpy as np
import pytest

from core.errors import DegenerateMeshError
from core.gallery import make_shape
from core.io import read_mesh, write_mesh
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.spectral import spectral_embedding as spectra
from service.studies.benchmark.stages import EMBEDDING, READING, REST, SAMPLING, STAGES, embed_bytes, watched

DATA = write_mesh(make_shape("pliers", 0), "ply")


def test_the_embedding_is_the_plain_one_and_every_stage_but_simplifying_takes_time():
    method = Pipeline(DEFAULT)
    embedding, seconds = embed_bytes(method, DATA, "ply")
    plain = method.embed(read_mesh(DATA, "ply"))
    np.testing.assert_array_equal(embedding.signature, plain.signature)
    np.testing.assert_array_equal(embedding.spectra[0].coordinates, plain.spectra[0].coordinates)
    assert set(seconds) == {READING, REST, *STAGES} == {READING, *SAMPLING, *EMBEDDING}
    assert {name for name, spent in seconds.items() if spent == 0.0} == {"simplify"}
    assert min(seconds.values()) >= 0.0


def test_a_stage_inside_another_counts_once(monkeypatch):
    """Cleaning is a stage of its own, and a part of simplifying."""
    clock = iter(range(100))
    monkeypatch.setattr("service.studies.benchmark.stages.perf_counter", lambda: float(next(clock)))
    small = DEFAULT.with_values(mesh={"decimate_above": 900, "decimate_to": 500})
    mesh = read_mesh(DATA, "ply")
    assert len(mesh.vertices) > 900
    with watched() as seconds:
        Pipeline(small).normalise(mesh)
    # The clock moves by one when it is read: at the beginning and the end of each stage, cleaning twice.
    assert seconds["clean"] == 2.0
    assert seconds["simplify"] == 3.0 - 1.0


def test_the_watch_is_taken_off_again():
    before = [getattr(*place) for places in STAGES.values() for place in places]
    point = Mesh(np.zeros((3, 3)), [[0, 1, 2]])
    with watched(), pytest.raises(DegenerateMeshError):
        Pipeline(DEFAULT).embed(point)
    assert [getattr(*place) for places in STAGES.values() for place in places] == before
    assert spectra.laplace_beltrami in before
