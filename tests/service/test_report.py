"""Reports: what their pictures show, and that the page is whole, safe and always the same."""

from typing import Any

import numpy as np
import pytest

from core.io import read_mesh
from core.mesh.mesh import Mesh
from core.registration.similarity import best_similarity
from service.rendering.tasks import FACES
from service.rendering.tasks import preview as make_preview
from service.rendering.thumbnail import camera, draw, draw_painted, upright
from service.report import SCORES, SIZE, Preview, matched, page
from service.search.schemas import MILLISECONDS, RESULT, Pair, Point, QueryAnswer, Result
from service.shapes.schemas import SHAPE
from service.system.schemas import Version
from tests.service.html import Parsed
from tests.service.previews.test_previews import pixels
from tests.service.support import small_file
from tests.studies.copies import moved

BALL = read_mesh(small_file(0), "off")
NASTY = '<script>alert("1")</script> & <b>.off'


def pairs(first: np.ndarray, second: np.ndarray) -> list[Pair]:
    ends = zip(first.tolist(), second.tolist(), strict=True)
    return [
        Pair(
            first=Point(sample=i, vertex=i, position=a),
            second=Point(sample=i, vertex=i, position=b),
            distance=0.0,
            effective=True,
        )
        for i, (a, b) in enumerate(ends)
    ]


def test_paint_in_the_colour_of_the_surface_changes_nothing() -> None:
    surface = np.tile(np.array([126, 158, 201]) / 255, (len(BALL.vertices), 1))
    assert draw_painted(BALL, "off", 64, BALL.vertices, surface) == draw(BALL, "off", 64)


def test_paint_shows_the_colour_of_the_points_that_are_near() -> None:
    right = camera()[0] @ upright("off")
    red, green = np.eye(3)[:2]
    painted = pixels(draw_painted(BALL, "off", 64, np.array([right, -right]), np.array([red, green])))
    assert (painted[32, 40:50, 0] > 1.3 * painted[32, 40:50, 1]).all()
    assert (painted[32, 14:24, 1] > 1.3 * painted[32, 14:24, 0]).all()


def test_paint_does_not_depend_on_the_triangles() -> None:
    """A square of two triangles, and one of 800, are painted by the places that are seen."""

    def square(count: int) -> Mesh:
        grid = np.linspace(-1, 1, count + 1)
        points = np.array([[x, 0, z] for z in grid for x in grid])
        at = np.arange((count + 1) ** 2).reshape(count + 1, -1)
        corners = [at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]]
        a, b, c, d = (each.ravel() for each in corners)
        return Mesh(points, np.vstack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))

    rng = np.random.default_rng(5)
    points, colours = rng.uniform(-1, 1, (40, 3)) * [1, 0, 1], rng.uniform(0.1, 1, (40, 3))
    coarse, fine = (pixels(draw_painted(square(n), "off", 64, points, colours)) for n in (1, 20))
    assert np.abs(coarse - fine).mean() < 1.0
    assert coarse[..., :3].std() > 20


@pytest.mark.parametrize("format", ["off", "obj"])
def test_points_of_a_file_are_found_on_its_preview(format: str) -> None:
    mesh = Mesh(25.4 * BALL.vertices * [1, 2, 3] + [100, -7, 3], BALL.faces)
    shown = Preview.of(make_preview(mesh, format, FACES), format)
    # A preview has a length of 2, in metres.
    np.testing.assert_allclose(shown.placed(mesh.vertices), shown.mesh.vertices, rtol=0, atol=1e-3)


def test_a_shape_and_its_moved_copy_are_painted_alike() -> None:
    there = Mesh(3 * BALL.vertices + [5, 6, 7], BALL.faces)
    first = Preview.of(make_preview(BALL, "off", FACES), "off")
    second = Preview.of(make_preview(there, "off", FACES), "off")
    one, other = matched(first, second, pairs(BALL.vertices, there.vertices))
    assert pixels(one).shape == (SIZE, SIZE, 4)
    assert np.abs(pixels(one) - pixels(other)).mean() < 0.5
    wrong = matched(first, second, pairs(BALL.vertices, there.vertices[::-1]))
    assert wrong[0] == one
    assert np.abs(pixels(wrong[1]) - pixels(one)).mean() > 5
    assert draw(first.mesh, "glb", SIZE) != one


def report(**changes: object) -> str:
    shape = {**RESULT["shape"], "name": NASTY, "tags": ["a<b", "c"], "metadata": {"<k>": ["</td>", 1]}}
    result = Result.model_validate({**RESULT, "shape": shape})
    answer: dict[str, Any] = {
        "query": {"facts": SHAPE["facts"], "unit": ""},
        "results": [result],
        "matched": True,
        "ranked_by": "combined",
        "compared": 5,
        "stored": 9,
        "pipeline": "3f1c",
        "milliseconds": MILLISECONDS,
        **changes,
    }
    return page(
        (NASTY, "ab" * 32),
        picture=b"query",
        options={"top_k": 3, "scale": "respect", "name": "</table>", "tag": [], "min_cc": None},
        answer=QueryAnswer.model_validate(answer),
        matches=((b"first", b"second"),) * len(answer["results"]),
        version=Version.model_validate(Version.model_config["json_schema_extra"]["example"]),
    )


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_copy_stands_as_the_query_and_a_mirror_image_as_in_a_mirror(mirrored: bool) -> None:
    mesh = Mesh(BALL.vertices * [1, 2, 3], BALL.faces)
    copy = moved(mesh, 1, scale=25.4, mirrored=mirrored)
    back = best_similarity(copy.vertices, mesh.vertices, sign=-1 if mirrored else 1, scaled=True).matrix
    first, second = (Preview.of(make_preview(each, "off", FACES), "off") for each in (mesh, copy))
    stands = second.in_frame_of(first, back.tolist(), mirrored=mirrored)
    expected = first.mesh.vertices * [-1 if mirrored else 1, 1, 1]
    np.testing.assert_allclose(stands.mesh.vertices, expected, rtol=0, atol=1.0)
    # Points of its file are found on it, and it is not inside out.
    np.testing.assert_allclose(stands.placed(copy.vertices), stands.mesh.vertices, rtol=0, atol=1.0)
    volumes = [np.linalg.det(each.mesh.vertices[each.mesh.faces]).sum() for each in (stands, first)]
    assert volumes[0] == pytest.approx(volumes[1], rel=1e-3)


def test_a_page_is_whole_and_holds_nothing_from_elsewhere() -> None:
    text = report()
    parsed = Parsed(text)
    assert parsed.pictures == [b"query", b"first", b"second"]
    assert not {"script", "b", "link", "a", "iframe"} & set(parsed.tags)
    assert not [name for name, _ in parsed.attributes if name.startswith("on") or name == "href"]
    assert text.count(NASTY) == 0
    assert parsed.texts.count(f"1. {NASTY}") == 1
    alternatives = [value for name, value in parsed.attributes if name == "alt"]
    assert alternatives == ["The query", f"{NASTY}, coloured", f"{NASTY}, coloured"]
    assert {*SCORES, *SCORES.values()} <= set(parsed.texts)
    assert {"a<b, c", '{"<k>": ["</td>", 1]}', "0.9810", "0.1420", "0.8740", "0.940"} <= set(parsed.texts)
    assert {"top_k", "3", "scale", "respect", "</table>", "ab" * 32, "default, 3f1c"} <= set(parsed.texts)
    assert not {"tag", "min_cc", "part distance"} & set(parsed.texts)
    assert "Another pose" in parsed.texts
    assert "Compared with 5 of 9 stored shapes." in parsed.texts


def test_the_times_that_the_stages_took_change_nothing() -> None:
    assert report(milliseconds={"total": 1.0}) == report()


def test_a_page_says_what_there_is_to_know() -> None:
    nothing = Parsed(report(results=[], matched=False, warnings=["a <hole>"]))
    assert nothing.pictures == [b"query"]
    assert {"No shape is among the results.", "a <hole>"} <= set(nothing.texts)
    weak = Parsed(report(matched=False, results=[{**RESULT, "likeness": "weak"}]))
    assert any("The nearest shapes follow" in text for text in weak.texts)
    assert not any("The nearest shapes" in text for text in Parsed(report()).texts)
    part = {**RESULT, "part_distance": 0.25}
    told = Parsed(report(results=[part]))
    assert "part distance" in told.texts
