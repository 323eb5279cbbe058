"""Normals in 3D: planes are flat whatever their triangles, edges are sharp, round surfaces are smooth."""

import numpy as np
import pytest
from playwright.sync_api import Page

from core.mesh.mesh import Mesh, face_normals
from tests.core.shapes import icosphere
from tests.soak.browser.support import Visit
from tests.studies.machine_parts import Drawing, part

NORMALS = """async ([positions, indices]) => {
  const { cornerNormals } = await import("./page/shading.js");
  return [...cornerNormals({ positions: new Float32Array(positions), indices: new Uint32Array(indices) })];
}"""


def corner_normals(page: Page, mesh: Mesh) -> np.ndarray:
    """The normals that the page shades by: shape (faces, corners, 3)."""
    found = page.evaluate(NORMALS, [mesh.vertices.ravel().tolist(), mesh.faces.ravel().tolist()])
    return np.reshape(found, (-1, 3, 3))


def unjoined(mesh: Mesh) -> Mesh:
    """The mesh as an STL file has it: each triangle with corners of its own."""
    return Mesh(mesh.vertices[mesh.faces.ravel()], np.arange(mesh.faces.size).reshape(-1, 3))


@pytest.fixture
def page(visit: Visit) -> Page:
    return visit.open()


def test_planes_of_slivers_and_their_edges(page: Page) -> None:
    mesh = part("plate", Drawing(3, 0.02))
    plate = Mesh(mesh.vertices / np.abs(mesh.vertices).max(), mesh.faces)
    sides = plate.vertices[plate.faces] - np.roll(plate.vertices[plate.faces], 1, axis=1)
    lengths = np.linalg.norm(sides, axis=2)
    assert (lengths.max(axis=1) > 50 * lengths.min(axis=1)).sum() > 30
    planes = face_normals(plate.vertices[plate.faces])
    flat = np.abs(planes[:, 2]) > 0.5
    for one in (plate, unjoined(plate)):
        normals = corner_normals(page, one)
        # Those of the planes of the plate, and of holes, whose walls are upright.
        assert np.abs(normals[flat] - planes[flat, None]).max() < 1e-4
        assert np.abs(normals[~flat, :, 2]).max() < 1e-4
    # The middle between two sides of a hole of many sides.
    walls = np.einsum("fcx,fx->fc", normals[~flat], planes[~flat])
    assert walls.min() > np.cos(np.radians(38))
    assert (walls < 1 - 1e-6).sum() > 100


def test_a_ball_is_round(page: Page) -> None:
    ball = icosphere(3)
    radial = ball.vertices / np.linalg.norm(ball.vertices, axis=1)[:, None]
    for one in (ball, unjoined(ball)):
        agreement = (corner_normals(page, one) * radial[ball.faces]).sum(axis=2)
        assert agreement.min() > np.cos(np.radians(1.0))
