"""Whatever happens to the bytes of a file: a valid mesh or a mesh error, and nothing else."""

import numpy as np
import pytest

from core.errors import MeshError
from core.io import Limits, read_mesh
from tests.core.io.files import PLAIN
from tests.core.io.mutation import mutation, small_sources, sources

FILES = (*small_sources(), *sources())
# Small, so that whatever passes is quick to read.
LIMITS = Limits(vertices=5_000, faces=5_000, parts=50)


def is_mesh_or_mesh_error(data, format):
    try:
        mesh = read_mesh(data, format, limits=LIMITS)
    except MeshError as error:
        message = str(error)
        assert message
        assert not any(sign in message for sign in ("Error", "array(", "site-packages", "\n"))
        return False
    assert np.isfinite(mesh.vertices).all()
    assert mesh.faces.min() >= 0
    assert mesh.faces.max() < len(mesh.vertices)
    assert len(mesh.faces) <= LIMITS.faces
    assert len(mesh.vertices) <= (LIMITS.vertices if format != "stl" else 3 * LIMITS.faces)
    return True


def test_the_files_to_change_are_sound_and_of_every_format():
    assert {format for format, _ in FILES} == {*PLAIN, "3mf"}
    assert all(is_mesh_or_mesh_error(data, format) for format, data in FILES)


@pytest.mark.parametrize("kind", range(len(small_sources())))
def test_a_small_file_that_is_changed(kind):
    for number in range(160):
        format, data = mutation(small_sources()[kind : kind + 1], 1, number)
        is_mesh_or_mesh_error(data, format)


@pytest.mark.parametrize("seed", range(3))
def test_a_file_that_is_changed(seed):
    taken = []
    for number in range(400):
        format, data = mutation(FILES, seed, number)
        taken.append(is_mesh_or_mesh_error(data, format))
    assert 0 < sum(taken) < len(taken)


@pytest.mark.parametrize("format", PLAIN)
def test_any_bytes_under_any_name(format):
    rng = np.random.default_rng(0)
    for _ in range(100):
        is_mesh_or_mesh_error(rng.bytes(int(rng.integers(300))), format)
    for _, data in FILES:
        is_mesh_or_mesh_error(data, format)
