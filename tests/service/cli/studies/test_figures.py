"""`isoshape figures`: its pictures and its page."""

import numpy as np
import pytest
from PIL import Image

from core.gallery.bodies import make_body
from core.mesh.mesh import Mesh
from service.cli.studies import figures
from service.rendering.drawing import SURFACE, Panel, draw_grid
from service.studies.figures.classes import UNMATCHED, class_colour, thumbnail
from service.studies.figures.spectral import match_figure

pytestmark = pytest.mark.studies

NAMES = {f"figures-{name}.png" for name in ("samples", "eigenmap", "match", "top", "confusion", "classes")}
PNG = b"\x89PNG\r\n\x1a\n"


def test_a_folder_of_meshes(run, collection, tmp_path):
    out = tmp_path / "new" / "out"
    done = run("figures", collection, "--limit", 6, "--out", out, "--class", "pliers")
    assert (done.status, done.stderr) == (0, "")
    assert {path.name for path in out.iterdir()} == NAMES | {"figures.md"}
    page = (out / "figures.md").read_text()
    for name in NAMES:
        assert f"]({name})" in page
        assert (out / name).read_bytes().startswith(PNG)
    assert "of 6 shapes in 3 classes" in page
    assert "two shapes of class pliers" in page


def test_without_a_folder_the_shapes_are_made(run, tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "POSES", 1)
    done = run("figures", "--out", tmp_path / "out")
    # One shape a class: nothing to pair, found before anything is drawn.
    assert done.status == 2
    assert "person has no two shapes" in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_made_pair_is_one_body_in_two_poses():
    first, second = figures._pair(None, "cup", [], [])
    np.testing.assert_array_equal(first.faces, second.faces)
    np.testing.assert_array_equal(first.vertices, make_body("cup").posed(0).vertices)


def test_a_class_that_is_not_there(run, collection, tmp_path):
    done = run("figures", collection, "--out", tmp_path / "out", "--class", "unicorn")
    assert done.status == 2
    assert "unicorn" in done.stderr


def test_a_match_is_drawn_the_same_again():
    body = make_body("pliers", vertices=600)
    assert match_figure(body.posed(0), body.posed(1)) == match_figure(body.posed(0), body.posed(1))


def test_classes_have_colours_of_their_own():
    colours = np.array([class_colour(i) for i in range(30)] + [UNMATCHED])
    gaps = np.linalg.norm(colours[:, None] - colours, axis=2)[np.triu_indices(len(colours), 1)]
    assert gaps.min() > 0.03


def test_thumbnails_have_few_faces():
    mesh = make_body("cup").rest
    assert len(thumbnail(mesh).faces) <= 2200
    assert thumbnail(make_body("pliers", vertices=600).rest).faces.shape[0] > 1000


@pytest.mark.parametrize("painted", [False, True])
def test_a_surface_has_the_colour_it_is_given(tmp_path, painted):
    square = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]), np.array([[0, 1, 2], [0, 2, 3]]))
    red = (1.0, 0.0, 0.0)
    panel = Panel(square, "", painted=np.array([red] * 4)) if painted else Panel(square, "", colour=red)
    for name, drawn in {"red": panel, "plain": Panel(square, "")}.items():
        (tmp_path / name).write_bytes(draw_grid([[drawn]]))
    red_pixels, plain_pixels = (
        np.asarray(Image.open(tmp_path / name).convert("RGB")) / 255.0 for name in ("red", "plain")
    )
    # All that the square covers but its edges, which are blended with the page.
    inside = np.median(red_pixels[np.abs(plain_pixels - 1.0).sum(axis=2) > 0.3], axis=0)
    assert inside[0] > 0.4
    assert inside[1:].max() < 0.05
    assert max(SURFACE) - min(SURFACE) < 0.1
