"""The graph of a mesh, the graph of its samples, and their minimum spanning tree."""

import itertools

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree

from core.graph.bridges import bridges
from core.graph.edge_graph import diagonals, edge_graph
from core.graph.geodesics import geodesic_distances
from core.graph.sparse_graph import sample_distances, sparse_graph
from core.mesh.cleaning import clean
from core.mesh.edges import half_edges
from core.mesh.mesh import Mesh
from tests.core.shapes import MANY_KINDS, blob, faces_shuffled, folded, icosphere, rectangle, turned


def sampled(graph, count, seed=0):
    return np.random.default_rng(seed).choice(graph.shape[0], size=count, replace=False)


@pytest.fixture(scope="module")
def graphs():
    """The graph of each of twenty meshes, with some of its vertices."""
    made = {name: edge_graph(clean(make()).mesh) for name, make in MANY_KINDS.items()}
    return {name: (graph, sampled(graph, min(80, graph.shape[0] // 2))) for name, graph in made.items()}


@pytest.mark.parametrize("name", MANY_KINDS)
def test_tree_weighs_what_the_tree_of_all_geodesic_distances_weighs(graphs, name):
    graph, samples = graphs[name]
    sparse = sparse_graph(graph, samples)
    complete = minimum_spanning_tree(dijkstra(graph, indices=samples)[:, samples])
    assert sparse.lengths[sparse.tree].sum() == pytest.approx(complete.sum(), rel=1e-12)


@pytest.mark.parametrize("name", ["octopus", "soup", "sheet", "loose parts"])
def test_tree_spans_the_samples_with_edges_of_their_graph(graphs, name):
    graph, samples = graphs[name]
    sparse = sparse_graph(graph, samples)
    edges = sparse.edges
    assert (edges[:, 0] < edges[:, 1]).all()
    assert (np.diff(edges[:, 0] * len(samples) + edges[:, 1]) > 0).all()
    assert len(np.unique(sparse.tree)) == len(samples) - 1
    assert np.isfinite(sample_distances(graph, samples, samples, sparse, "tree")).all()


@pytest.mark.parametrize("name", ["hand", "soup", "sphere"])
def test_distances_from_the_mesh_to_the_tree_only_grow(graphs, name):
    graph, samples = graphs[name]
    sparse = sparse_graph(graph, samples)
    over_mesh = geodesic_distances(graph, samples)
    over_graph, over_tree = (
        sample_distances(graph, samples, samples, sparse, kind) for kind in ("graph", "tree")
    )
    assert (over_mesh == over_mesh.T).all()
    assert (over_mesh <= over_graph + 1e-12).all()
    assert (over_graph <= over_tree + 1e-12).all()
    nearest = np.where(np.eye(len(samples)), np.inf, over_mesh)
    np.testing.assert_allclose(over_graph[nearest.argmin(axis=0), range(len(samples))], nearest.min(axis=0))


def test_one_sample_or_all_vertices():
    graph = edge_graph(icosphere(1))
    assert len(sparse_graph(graph, np.array([3])).tree) == 0
    everything = sparse_graph(graph, np.arange(graph.shape[0]))
    assert len(everything.edges) == graph.nnz // 2


@pytest.mark.parametrize("seed", range(4))
def test_sparse_graph_of_a_mesh_full_of_ties_does_not_hang_on_how_it_is_given(seed):
    # On a sheet of equal cells many vertices are as far from one sample as from another.
    sheet = rectangle(3, 2, 12, 8)
    samples = sampled(edge_graph(sheet), 30)
    order = np.random.default_rng(seed).permutation(len(sheet.vertices))
    place = np.argsort(order)
    changed = faces_shuffled(turned(Mesh(sheet.vertices[order], place[sheet.faces]), seed), seed)
    expected = sparse_graph(edge_graph(sheet), samples)
    found = sparse_graph(edge_graph(changed), place[samples])
    assert found.edges.tolist() == expected.edges.tolist()
    np.testing.assert_allclose(found.lengths, expected.lengths)


@pytest.mark.parametrize("fold", np.linspace(-3.0, 3.0, 7))
def test_diagonal_is_as_long_across_a_fold_as_when_it_is_laid_flat(fold):
    flat = np.array([[0, 0, 0], [1, 0, 0], [0.4, 0.8, 0], [0.7, -0.5, 0]])
    bent = flat.copy()
    bent[3] = [0.7, -0.5 * np.cos(fold), 0.5 * np.sin(fold)]
    for vertices in (flat, bent):
        ends, lengths = diagonals(vertices, np.array([[0, 1, 2], [0, 3, 1]]))
        assert sorted(ends[0]) == [2, 3]
        assert lengths == pytest.approx([np.hypot(0.3, 1.3)])


def test_no_diagonal_where_the_straight_way_leaves_the_two_faces():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [2, 1, 0], [2, -1, 0]], dtype=float)
    assert len(diagonals(vertices, np.array([[0, 1, 2], [0, 3, 1]]))[0]) == 0


def test_no_diagonal_through_a_corner_however_it_is_rounded():
    # The straight way from 2 to 3 passes through vertex 1: it is two edges, whatever rounding makes of it.
    bowtie = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, -1, 0]], [[0, 1, 2], [0, 3, 1]])
    for seed in range(20):
        mesh = turned(bowtie, seed)
        assert len(diagonals(mesh.vertices, mesh.faces)[0]) == 0


def test_diagonals_of_three_sheets_on_an_edge_join_every_two_in_any_order():
    expected = {frozenset(pair) for pair in itertools.combinations((2, 3, 4), 2)}
    for seed in range(6):
        mesh = faces_shuffled(folded(), seed)
        assert {frozenset(pair) for pair in diagonals(mesh.vertices, mesh.faces)[0].tolist()} == expected


def test_paths_are_nearer_to_the_geodesics_with_diagonals():
    ball = icosphere(4)
    ends = sampled(edge_graph(ball), 40)
    points = ball.vertices[ends]
    true = np.arccos(np.clip(points @ points.T, -1, 1))
    errors = []
    for unfold in (False, True):
        ways = geodesic_distances(edge_graph(ball, unfold=unfold), ends)
        assert (ways >= 0.999 * true - 1e-6).all()
        errors.append((ways - true).sum() / true.sum())
    assert errors[1] < 0.5 * errors[0]


def test_lengths_are_those_of_the_edges():
    ball = blob(subdivisions=2)
    graph = edge_graph(ball, unfold=False)
    edges = half_edges(ball.faces).edges
    expected = np.linalg.norm(ball.vertices[edges[:, 0]] - ball.vertices[edges[:, 1]], axis=1)
    np.testing.assert_allclose(graph[edges[:, 0], edges[:, 1]], expected)
    assert graph.nnz == 2 * len(edges)
    assert abs(graph - graph.T).max() == 0.0


def test_one_part_needs_no_bridge():
    ball = icosphere(1)
    assert bridges(ball.vertices, np.zeros(len(ball.vertices), dtype=np.int64)).shape == (0, 2)
