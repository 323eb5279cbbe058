"""Bridges, compared with the plain method, k-d trees for each bit of the labels; the tree of boxes."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from core.graph.bridges import bridges
from core.mesh.box_tree import LEAF, box_tree
from core.mesh.ordering import TIE, tied_ranks
from tests.core.shapes import rotation


def plain_bridges(vertices, labels):
    """The reference for `bridges`: two components differ in some bit of their labels."""
    labels = labels.copy()
    chosen = [np.empty((0, 2), dtype=np.int64)]
    everything = cKDTree(vertices)
    smallest = TIE * np.ptp(vertices, axis=0).max()
    number = int(labels.max()) + 1
    while number > 1:
        gap = np.full(len(vertices), np.inf)
        for bit in range((number - 1).bit_length()):
            side = (labels >> bit) & 1 == 1
            for mine, theirs in ((side, ~side), (~side, side)):
                distance = cKDTree(vertices[theirs]).query(vertices[mine])[0]
                gap[mine] = np.minimum(gap[mine], distance)
        gap = np.maximum(gap, smallest)
        rank = tied_ranks(np.log(gap))
        order = np.lexsort((rank, labels))
        lead = order[np.unique(labels[order], return_index=True)[1]]
        lead = lead[np.argsort(rank[lead], kind="stable")]
        near = everything.query_ball_point(vertices[lead], gap[lead] * (1.0 + TIE))
        pairs = np.array(
            [[v, min(u for u in ball if labels[u] != labels[v])] for v, ball in zip(lead, near, strict=True)]
        )
        ends = labels[pairs]
        place = np.arange(1, number + 1)
        links = coo_array((place, (ends[:, 0], ends[:, 1])), shape=(number, number)).tocsr()
        tree = minimum_spanning_tree(links.maximum(links.T))
        chosen.append(pairs[np.sort(tree.data.astype(np.int64)) - 1])
        number, group = connected_components(tree, directed=False)
        labels = group.astype(np.int64)[labels]
    return np.concatenate(chosen)


def cubes(side, step):
    """Unit cubes on a grid, `step` apart: gaps are exactly equal, or 0 where the step is 1."""
    corners = np.indices((2, 2, 2)).reshape(3, -1).T
    places = np.indices((side, side, side)).reshape(3, -1).T
    vertices = (step * places[:, None] + corners).reshape(-1, 3).astype(np.float64)
    return vertices, np.repeat(np.arange(len(places)), 8)


def triangles(count, size, seed=0):
    """Components of three vertices each, `size` across, at random places."""
    draw = np.random.default_rng(seed)
    vertices = draw.normal(size=(count, 1, 3)) + size * draw.normal(size=(count, 3, 3))
    return vertices.reshape(-1, 3), np.repeat(np.arange(count), 3)


def drawn(count, components, decimals, seed):
    """Points of random components, rounded, so that many coincide and many gaps are equal."""
    draw = np.random.default_rng(seed)
    return draw.normal(size=(count, 3)).round(decimals), np.arange(count) % components


def turned(case, seed=1):
    vertices, labels = case
    return np.ascontiguousarray(vertices @ rotation(seed).T), labels


def shuffled(case, seed=2):
    """Vertices in another order; components as numbered there."""
    vertices, labels = case
    draw = np.random.default_rng(seed)
    order, number = draw.permutation(len(labels)), draw.permutation(labels.max() + 1)
    return vertices[order], number[labels[order]]


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(cubes(4, 3.0), id="equal gaps"),
        pytest.param(shuffled(cubes(5, 1.5)), id="equal gaps, shuffled"),
        pytest.param(turned(cubes(4, 3.0)), id="equal gaps, turned"),
        pytest.param(turned(cubes(4, 1.0)), id="corner on corner, turned"),
        pytest.param(triangles(400, 0.05), id="triangles"),
        pytest.param(triangles(400, 1e-12), id="triangles of no size"),
        pytest.param(shuffled(drawn(900, 30, 1, seed=0)), id="rounded"),
        pytest.param(drawn(600, 200, 0, seed=1), id="coincident"),
        pytest.param(drawn(500, 2, 3, seed=2), id="two components"),
        pytest.param(drawn(2, 2, 9, seed=3), id="two vertices"),
        pytest.param(drawn(LEAF + 1, 3, 9, seed=4), id="two leaves"),
    ],
)
def test_as_the_plain_method_to_the_vertex(case):
    vertices, labels = case
    assert labels.max() > 0
    found = bridges(vertices, labels)
    np.testing.assert_array_equal(found, plain_bridges(vertices, labels))
    assert found.dtype == np.int64


def test_given_arrays_may_be_read_only_and_stay_as_they_are():
    vertices, labels = triangles(20, 0.1)
    expected = plain_bridges(vertices, labels)
    vertices.flags.writeable = labels.flags.writeable = False
    np.testing.assert_array_equal(bridges(vertices, labels), expected)


@pytest.mark.parametrize(
    "points",
    [drawn(3000, 1, 1, seed=5)[0], drawn(2 * LEAF + 1, 1, 9, seed=6)[0], np.ones((100, 3)), np.ones((1, 3))],
    ids=["rounded", "three leaves", "coincident", "one"],
)
def test_boxes_of_a_tree_hold_its_points(points):
    order = np.random.default_rng(0).permutation(len(points))
    boxes = box_tree(points[:, None], order)
    inner = len(boxes) // 2
    for leaf, box in enumerate(boxes[inner:]):
        inside = points[order[leaf * LEAF : (leaf + 1) * LEAF]]
        if len(inside):
            np.testing.assert_array_equal(box, [inside.min(axis=0), inside.max(axis=0)])
    np.testing.assert_array_equal(boxes[:inner, 0], np.minimum(boxes[1::2, 0], boxes[2::2, 0]))
    np.testing.assert_array_equal(boxes[:inner, 1], np.maximum(boxes[1::2, 1], boxes[2::2, 1]))
