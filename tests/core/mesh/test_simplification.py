"""Simplification of large meshes: the surface stays, and so do its pieces and its coarse parts."""

import pytest

from core.evaluation.perturbation import subdivide
from core.mesh.cleaning import clean, face_areas
from core.mesh.mesh import Mesh
from core.mesh.simplification import FINENESS, simplify
from tests.core.shapes import box, icosphere, joined, shifted, turned

WANTED = 600


def fine(mesh):
    while len(mesh.vertices) <= FINENESS * WANTED:
        mesh = subdivide(mesh, 1.0, 0)
    return mesh


def area(vertices, faces):
    return face_areas(vertices, faces).sum()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("extents", [(3, 2, 1), (3, 2, 0.3)])
def test_flat_sides_of_a_large_mesh_become_few_faces(extents, seed):
    # Quadric collapses that stop on flat sides would go on elsewhere, and remove the shape.
    block = fine(turned(box(*extents), seed))
    small = simplify(block, WANTED)
    assert abs(len(small.vertices) - WANTED) < 0.05 * WANTED
    assert area(small.vertices, small.faces) == pytest.approx(area(block.vertices, block.faces), rel=0.01)


def test_plates_close_to_each_other_stay_apart():
    ball = icosphere(5)
    plate = Mesh(ball.vertices * (1, 1, 0.01), ball.faces)
    pile = joined(*(shifted(plate, (0, 0, 0.03 * i)) for i in range(3)))
    small = clean(simplify(pile, WANTED))
    assert small.components == 3
    assert area(small.mesh.vertices, small.mesh.faces) == pytest.approx(
        area(pile.vertices, pile.faces), rel=0.02
    )


def test_the_same_mesh_gives_the_same_bytes():
    mesh = fine(turned(icosphere(4), 1))
    first, second = simplify(mesh, WANTED), simplify(Mesh(mesh.vertices, mesh.faces), WANTED)
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.faces.tobytes() == second.faces.tobytes()
