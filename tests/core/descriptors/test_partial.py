"""Distances of surfaces of which either may be a part of the other, against plain references."""

import tracemalloc
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from core.arrays import Bytes
from core.descriptors import partial
from core.descriptors.partial import (
    BATCH,
    BOUNDARY_MARGIN,
    INCOMPLETE,
    MISSING_SHARES,
    PART_ROWS,
    ROW_COUNTS,
    ROW_LENGTH,
    DescriptorDistance,
    describe_part,
    part_distances,
    whole_distances,
)
from core.descriptors.spin_images import (
    BINS,
    BYTE_SCALE,
    KEYPOINTS,
    RADII,
    SPIN_IMAGE_LENGTH,
    spin_image_count,
    spin_image_distances,
    spin_images,
)
from core.embedding import Embedding
from core.evaluation.perturbation import cut_part, subdivide
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from tests.core.shapes import box, prism, scaled, shifted, turned
from tests.gallery import make_shape
from tests.studies.perturbation import make_soup

PIPELINE = Pipeline(DEFAULT)


@cache
def embedded(label: str, cut: float = 0.0) -> Embedding:
    mesh = make_shape(label, 0)
    return PIPELINE.embed(cut_part(mesh, cut, 3) if cut else mesh)


def rows_of(label: str, cut: float = 0.0) -> Bytes:
    return spin_images_of(embedded(label, cut))


def spin_images_of(embedding: Embedding) -> Bytes:
    return np.asarray(embedding.descriptors["spin_images"])


def descriptor_distance(query: Bytes, others: list[Bytes]) -> DescriptorDistance:
    return partial.descriptor_distance(query, others, whole_distances(query, others))


def test_an_incomplete_surface_has_rows_as_a_part_too() -> None:
    whole, part = rows_of("octopus"), rows_of("octopus", 0.3)
    assert whole.shape == (KEYPOINTS, ROW_LENGTH) == (ROW_COUNTS[False], ROW_LENGTH)
    assert part.shape == (KEYPOINTS + PART_ROWS, ROW_LENGTH) == (ROW_COUNTS[True], ROW_LENGTH)
    assert (whole[:, SPIN_IMAGE_LENGTH:] == 1).all()


def test_complete_surfaces_are_as_far_as_the_farther_way() -> None:
    first, second = rows_of("octopus"), rows_of("cup")
    found = descriptor_distance(first, [second, first])
    assert_array_equal(found.part, [False, False])
    assert_array_equal(
        found.distance,
        [spin_image_distances(first[:, :SPIN_IMAGE_LENGTH], [second[:, :SPIN_IMAGE_LENGTH]]).max(), 0.0],
    )


def test_a_part_needs_no_partner_for_what_it_lacks() -> None:
    part, whole = rows_of("octopus", 0.3), rows_of("octopus")
    found = descriptor_distance(part, [whole, rows_of("cup")])
    assert_array_equal(found.part, [True, True])
    assert found.distance[0] == part_distances(part[KEYPOINTS:], [whole[:, :SPIN_IMAGE_LENGTH]])[0]
    assert found.distance[0] < found.distance[1]


def test_either_of_two_parts_may_be_in_the_other() -> None:
    small, large = rows_of("octopus", 0.5), rows_of("octopus", 0.2)
    both = [
        part_distances(a[KEYPOINTS:], [b[:KEYPOINTS, :SPIN_IMAGE_LENGTH]])[0]
        for a, b in ((small, large), (large, small))
    ]
    assert descriptor_distance(small, [large]).distance[0] == min(both) < max(both)


def test_the_distance_is_the_same_both_ways_whatever_others_there_are() -> None:
    shapes = [rows_of(label, cut) for label in ("octopus", "cup", "bird") for cut in (0.0, 0.3)]
    rows = [descriptor_distance(shape, shapes) for shape in shapes]
    distance, part = np.stack([row.distance for row in rows]), np.stack([row.part for row in rows])
    assert_array_equal(distance, distance.T)
    assert_array_equal(part, part.T)
    assert (distance.diagonal() == 0.0).all()
    for i, shape in enumerate(shapes):
        for j, other in enumerate(shapes):
            assert descriptor_distance(shape, [other]).distance[0] == distance[i, j]


def test_a_soup_of_triangles_is_no_part() -> None:
    soup = PIPELINE.embed(make_soup(make_shape("octopus", 0), 0.02, 0))
    assert soup.facts.boundary_edges > 1000
    assert soup.facts.boundary_ratio <= INCOMPLETE
    assert spin_images_of(soup).shape == (KEYPOINTS, ROW_LENGTH)
    wholes = [rows_of(label) for label in ("bird", "cup", "octopus", "person")]
    assert descriptor_distance(spin_images_of(soup), wholes).distance.argmin() == 2


def test_the_chance_of_a_part_is_the_same_both_ways_and_its_whole_is_the_likeliest() -> None:
    part = embedded("person", 0.3)
    wholes = [embedded(label) for label in ("bird", "cup", "octopus", "person", "plane", "quadruped")]
    probabilities = PIPELINE.combined(part, wholes, PIPELINE.score(part, wholes))
    assert probabilities.argmax() == 3
    for whole, class_probability in zip(wholes, probabilities, strict=True):
        back = PIPELINE.combined(whole, [part], PIPELINE.score(whole, [part]))
        assert back[0] == pytest.approx(class_probability, rel=1e-12)


def test_a_coarse_mesh_and_a_fine_one_of_the_same_box_are_alike() -> None:
    """Corners of a coarse mesh are no noise: smoothing would make a blob of it."""
    fine = coarse = box(3.0, 1.0, 0.6)
    for _ in range(5):
        fine = subdivide(fine, 1.0, 0)
    first, second = PIPELINE.embed(coarse), PIPELINE.embed(fine)
    assert descriptor_distance(spin_images_of(first), [spin_images_of(second)]).distance[0] < 0.4
    scores = PIPELINE.score(first, [second])
    assert scores.cc[0] > 0.98
    assert PIPELINE.combined(first, [second], scores)[0] > 0.9
    blob = Pipeline(DEFAULT.with_values(mesh={"smooth_refined": False}))
    assert (
        descriptor_distance(spin_images_of(blob.embed(coarse)), [spin_images_of(blob.embed(fine))]).distance[
            0
        ]
        > 1.0
    )


CLASSES = ("bird", "cup", "octopus", "person", "plane", "quadruped")


@cache
def wholes() -> dict[str, Mesh]:
    return {label: make_shape(label, 0) for label in CLASSES}


@cache
def known() -> list[Bytes]:
    return [spin_images(clean(mesh).mesh).bytes for mesh in wholes().values()]


def part(mesh: Mesh) -> Bytes:
    return describe_part(clean(mesh).mesh)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5])
def test_a_part_is_found_wherever_it_lies_and_in_any_unit(share: float) -> None:
    for place, mesh in enumerate(wholes().values()):
        cut = turned(cut_part(mesh, share, place), 1)
        piece = subdivide(shifted(scaled(cut, 0.01), [1.0, -2.0, 3.0]), 0.3, 1)
        assert part_distances(part(piece), known()).argmin() == place


def plain(rows: Bytes, whole: Bytes) -> float:
    """The mean over the balls that count, for the share of missing area that makes it least."""
    found, start = [], 0
    for missing in MISSING_SHARES:
        total = balls = 0.0
        for row in rows[start : start + spin_image_count(missing)].astype(float):
            squares = (whole.astype(float) - row[:SPIN_IMAGE_LENGTH]) ** 2
            total += min(
                (squares.reshape(KEYPOINTS, len(RADII), BINS).sum(axis=2) * row[SPIN_IMAGE_LENGTH:]).sum(
                    axis=1
                )
            )
            balls += row[SPIN_IMAGE_LENGTH:].mean()
        found.append(total / balls / BYTE_SCALE**2)
        start += spin_image_count(missing)
    return min(found)


def test_distances_are_those_of_a_search_over_all_pairs_and_hang_on_no_other() -> None:
    rows = part(cut_part(wholes()["person"], 0.4, 0))
    many = [known()[i % len(known())] for i in range(2 * BATCH + 1)]
    found = part_distances(rows, many)
    assert found[: len(known())] == pytest.approx([plain(rows, whole) for whole in known()], rel=1e-12)
    for distance, whole in zip(found, many, strict=True):
        assert_array_equal(distance, part_distances(rows, [whole])[0])


def test_balls_that_reach_beyond_the_rim_do_not_count() -> None:
    surface = clean(cut_part(wholes()["person"], 0.4, 0)).mesh
    counts = describe_part(surface)[:, SPIN_IMAGE_LENGTH:]
    assert counts.shape == (PART_ROWS, len(RADII))
    found, start = spin_images(surface), 0
    away = _from_rim(surface, found.points)
    for ball, radius in enumerate(RADII):
        wanted = away > BOUNDARY_MARGIN * radius * found.unit
        sure = (
            np.abs(away - BOUNDARY_MARGIN * radius * found.unit)
            > 0.2 * BOUNDARY_MARGIN * RADII[0] * found.unit
        )
        assert_array_equal(counts[start : start + KEYPOINTS, ball][sure], wanted[sure])
        assert 0.3 < wanted.mean() < 1.0
        assert sure.mean() > 0.9
    assert part(wholes()["person"])[:, SPIN_IMAGE_LENGTH:].all()


def test_where_nearly_all_is_rim_all_balls_count() -> None:
    assert part(prism(1000, 0.01))[:, SPIN_IMAGE_LENGTH:].all()


def test_long_open_edges_are_rim_all_along() -> None:
    """A box of 8 vertices without one end."""
    whole = box(2.1, 1.0, 0.6)
    at_end = (whole.vertices[whole.faces][:, :, 0] > 1.0).all(axis=1)
    surface = clean(Mesh(whole.vertices, whole.faces[~at_end])).mesh
    found, counts = spin_images(surface), describe_part(surface)[:KEYPOINTS, SPIN_IMAGE_LENGTH:]
    away = _from_rim(surface, found.points)
    for ball, radius in enumerate(RADII):
        near = away < 0.8 * BOUNDARY_MARGIN * radius * found.unit
        assert near.any()
        assert not counts[near, ball].any()


def test_a_needle_takes_no_more_memory_than_another_part() -> None:
    needle = Mesh(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1e-9, 0.0]]), np.array([[0, 1, 2]]))
    tracemalloc.start()
    rows = describe_part(needle)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert rows.shape == (PART_ROWS, SPIN_IMAGE_LENGTH + len(RADII))
    assert peak < 50e6


def _from_rim(surface: Mesh, points: np.ndarray) -> np.ndarray:
    """Distances from the open edges, as line segments."""
    sides: dict[tuple[int, int], int] = {}
    for face in surface.faces.tolist():
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            sides[min(a, b), max(a, b)] = sides.get((min(a, b), max(a, b)), 0) + 1
    ends = surface.vertices[[list(ends) for ends, count in sides.items() if count == 1]]
    start, step = ends[:, 0], ends[:, 1] - ends[:, 0]
    along = ((points[:, None] - start) * step).sum(axis=2) / (step**2).sum(axis=1)
    feet = start + np.clip(along, 0.0, 1.0)[..., None] * step
    return np.asarray(np.linalg.norm(points[:, None] - feet, axis=2).min(axis=1))
