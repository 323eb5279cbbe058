"""The whole method: what an embedding holds, facts in closed form, odd meshes, and the same bytes again."""

import hashlib
import os
import pickle
import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from core.descriptors.facts import GLOBAL_DESCRIPTORS
from core.descriptors.views import view_descriptor, view_distance
from core.embedding import Embedding
from core.errors import DegenerateMeshError, IncompatibleEmbeddingsError
from core.mesh.cleaning import clean, face_areas
from core.mesh.mesh import Mesh
from core.mesh.subdivision import refine
from core.parameters import DEFAULT, PAPER
from core.pipeline import Pipeline
from core.serialization import embedding_to_bytes
from core.sparse_embedding import prepared
from tests.core.shapes import blob, box, folded, joined, prism, rectangle, shifted, soup
from tests.gallery import make_shape
from tests.studies.perturbation import add_noise, make_soup

SETTINGS = {"default": DEFAULT, "paper": PAPER}

SHAPES = [("spider", 0), ("spider", 1), ("hand", 0)]


@cache
def embedded_by(setting):
    """A pipeline, and embeddings of the shapes under it."""
    pipeline = Pipeline(SETTINGS[setting])
    return pipeline, [pipeline.embed(make_shape(*shape)) for shape in SHAPES]


@pytest.fixture(params=SETTINGS)
def embedded(request):
    return embedded_by(request.param)


def to_surface(points, mesh):
    """At most how far each point lies from the surface: to the nearest of the forty triangles about it."""
    triangles = mesh.vertices[mesh.faces]
    about = cKDTree(triangles.mean(axis=1)).query(points, k=40)[1].ravel()
    repeated = np.repeat(points.astype(np.float64), 40, axis=0)
    gaps = np.linalg.norm(trimesh.triangles.closest_point(triangles[about], repeated) - repeated, axis=1)
    return gaps.reshape(-1, 40).min(axis=1)


def test_fields_have_their_shapes_and_types(embedded):
    pipeline, embeddings = embedded
    sampling, spectral = pipeline.parameters.sampling, pipeline.parameters.spectral
    for made in embeddings:
        m, edges = len(made.positions), len(made.graph_edges)
        signature = spectral.affinity_values + spectral.laplacian_values + GLOBAL_DESCRIPTORS
        assert made.fingerprint == pipeline.fingerprint
        for array, kind, shape in (
            (made.positions, np.float32, (m, 3)),
            (made.vertices, np.int32, (m,)),
            (made.graph_edges, np.int32, (edges, 2)),
            (made.graph_lengths, np.float32, (edges,)),
            (made.tree_edges, np.int32, (m - 1, 2)),
            (made.regions, np.int32, (max(m, sampling.points),)),
            (made.signature, np.float32, (signature,)),
        ):
            assert array.dtype == kind
            assert array.shape == shape
        assert tuple(spectrum.name for spectrum in made.spectra) == spectral.operators
        for spectrum in made.spectra:
            assert spectrum.coordinates.shape == (len(made.regions), spectral.dimensions)
            assert spectrum.coordinates.dtype == spectrum.eigenvalues.dtype == np.float32
            assert len(spectrum.eigenvalues) >= spectral.dimensions


def test_every_point_belongs_to_a_sample_and_every_sample_to_itself(embedded):
    for made in embedded[1]:
        m = len(made.positions)
        assert np.array_equal(made.regions[:m], np.arange(m))
        assert 0 <= made.regions.min() <= made.regions.max() < m


def test_samples_lie_on_the_surface_and_beside_their_vertex(embedded):
    for made, shape in zip(embedded[1], SHAPES, strict=True):
        mesh = make_shape(*shape)
        assert to_surface(made.positions, mesh).max() < 1e-5 * made.facts.scale
        gaps = np.linalg.norm(made.positions[:, None] - mesh.vertices[None], axis=2)
        own = gaps[np.arange(len(gaps)), made.vertices]
        assert own == pytest.approx(gaps.min(axis=1), abs=1e-5 * made.facts.scale)
        assert len(np.unique(made.positions, axis=0)) == len(made.positions)


def test_score_is_match(embedded):
    pipeline, embeddings = embedded
    for query in embeddings:
        scores = pipeline.score(query, embeddings)
        for i, candidate in enumerate(embeddings):
            found = pipeline.match(query, candidate)
            assert (scores.cc[i], scores.ssd[i], scores.sim[i]) == (found.cc, found.ssd, found.sim)
            assert found.correspondence.dtype == np.int32


def test_no_candidates_no_scores(embedded):
    pipeline, embeddings = embedded
    scores = pipeline.score(embeddings[0], [])
    assert scores.cc.shape == scores.ssd.shape == scores.sim.shape == (0,)


def test_embeddings_of_other_parameters_are_refused(embedded):
    pipeline, (first, second, _) = embedded
    other = replace(second, fingerprint="0" * 16)
    for pair in ((first, other), (other, first)):
        with pytest.raises(IncompatibleEmbeddingsError):
            pipeline.match(*pair)
        with pytest.raises(IncompatibleEmbeddingsError):
            pipeline.score(pair[0], [pair[1]])


def test_the_cache_of_prepared_shapes_is_bounded_and_changes_no_score(embedded):
    pipeline, embeddings = embedded
    expected = pipeline.score(embeddings[0], embeddings)
    one = pipeline.prepared(embeddings[0]).nbytes
    small = Pipeline(pipeline.parameters, memory=int(2.5 * one))
    for _ in range(2):
        scores = small.score(embeddings[0], embeddings)
        assert np.array_equal(scores.cc, expected.cc)
        assert np.array_equal(scores.ssd, expected.ssd)
        assert np.array_equal(scores.sim, expected.sim)
        held = sum(ready.nbytes for ready in small._prepared.values())
        assert held == small._prepared.currsize
        assert 0 < held <= 2.5 * one


def test_a_met_embedding_is_factored_once(embedded):
    pipeline, embeddings = embedded
    assert pipeline.prepared(embeddings[0]) is pipeline.prepared(embeddings[0])


def test_the_same_mesh_gives_the_same_bytes_in_another_process(embedded):
    pipeline, embeddings = embedded
    code = (
        "import hashlib\n"
        "from core import parameters\n"
        "from core.gallery import make_shape\n"
        "from core.pipeline import Pipeline\n"
        "from core.serialization import embedding_to_bytes\n"
        f"pipeline = Pipeline(parameters.{pipeline.parameters.name.upper()})\n"
        f"made = pipeline.embed(make_shape{SHAPES[0]})\n"
        "print(hashlib.sha256(embedding_to_bytes(made)).hexdigest())\n"
    )
    out = subprocess.run(
        [sys.executable, "-c", code],
        # The linear algebra's own variables choose its kernels, and with them the last bits.
        env={**os.environ, "PYTHONPATH": ":".join(sys.path), "PYTHONHASHSEED": "7"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert out.strip() == hashlib.sha256(embedding_to_bytes(embeddings[0])).hexdigest()


@pytest.mark.parametrize(
    ("changes", "count"),
    [
        ({"samples": 0, "tau": 0.3, "sample_cap": 0}, round(0.3 * 642)),
        ({"samples": 0, "tau": 0.5, "sample_cap": 0}, 321),
        ({"samples": 0, "tau": 1.0, "sample_cap": 0}, 642),
        ({"samples": 0, "tau": 0.3, "sample_cap": 50}, 50),
        ({"samples": 0, "tau": 0.1, "sample_cap": 400}, 64),
        ({"samples": 60, "tau": 0.3, "sample_cap": 0}, 60),
    ],
)
def test_as_many_samples_as_asked(changes, count):
    assert len(Pipeline(PAPER.with_values(sampling=changes)).embed(blob(3)).positions) == count


BOX = box(3, 2, 1)
KNOWN = {
    "box": (
        BOX,
        {"vertices": 8, "faces": 12, "area": 22.0, "volume": 6.0, "components": 1, "merged_vertices": 0,
         "dropped_faces": 0, "boundary_edges": 0, "nonmanifold_edges": 0},
    ),
    "sheet": (
        rectangle(3, 2, 18, 12),
        {"area": 6.0, "volume": 0.0, "scale": np.sqrt((3**2 + 2**2) / 12), "boundary_edges": 2 * (18 + 12)},
    ),
    "open box": (
        Mesh(BOX.vertices, BOX.faces[(BOX.vertices[BOX.faces][:, :, 2] < 0).any(axis=1)]),
        {"faces": 10, "boundary_edges": 4, "area": 22.0 - 6.0},
    ),
    "soup": (soup(BOX, 1.0), {"vertices": 36, "merged_vertices": 28, "boundary_edges": 0}),
    "repeated faces": (
        Mesh(BOX.vertices, np.concatenate([BOX.faces, BOX.faces[:2, [1, 2, 0]], [[0, 0, 1]]])),
        {"faces": 15, "dropped_faces": 3, "area": 22.0},
    ),
    "four boxes": (joined(*(shifted(BOX, (4 * i, 0, 0)) for i in range(4))), {"components": 4}),
    "three sheets on an edge": (folded(), {"nonmanifold_edges": 1, "boundary_edges": 6}),
}  # fmt: skip


@pytest.mark.parametrize("name", KNOWN)
def test_facts_are_those_of_the_closed_form(name):
    mesh, expected = KNOWN[name]
    facts = vars(Pipeline(PAPER).embed(mesh).facts)
    assert {fact: facts[fact] for fact in expected} == pytest.approx(expected, abs=1e-12)


TETRAHEDRON = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])

ODD = {
    "single triangle": Mesh([[0, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
    "coplanar square": rectangle(1, 1, 1, 1),
    "open cylinder": prism(24, 3.0),
    "three sheets on an edge": folded(),
    "two loose tetrahedra": joined(TETRAHEDRON, shifted(TETRAHEDRON, (5, 0, 0))),
    "cube": box(1, 1, 1),
    "loose triangles": Mesh(
        np.random.default_rng(5).normal(size=(600, 3)), np.arange(600, dtype=np.int64).reshape(-1, 3)
    ),
    "sliver between two sheets": Mesh(
        [[0, 0, 0], [1, 0, 0], [0.5, 0, 0], [0.4, 1, 0], [0.6, -1, 0]], [[0, 1, 3], [0, 2, 1], [0, 4, 2]]
    ),
    "needle": Mesh([[0, 0, 0], [1, 0, 0], [0.5, 1e-4, 0]], [[0, 1, 2]]),
    "needle on a cube": joined(box(1, 1, 1), Mesh([[3, 0, 0], [9, 0, 0], [6, 1e-5, 0]], [[0, 1, 2]])),
}


@pytest.mark.parametrize("setting", SETTINGS)
@pytest.mark.parametrize("kind", ODD)
def test_odd_meshes_are_embedded(kind, setting):
    pipeline = Pipeline(SETTINGS[setting])
    made = pipeline.embed(ODD[kind])
    assert isinstance(made, Embedding)
    for array in (made.positions, made.graph_lengths, made.signature):
        assert np.isfinite(array).all()
    for spectrum in made.spectra:
        assert np.isfinite(spectrum.coordinates).all()
        assert np.isfinite(spectrum.eigenvalues).all()
    assert len(made.positions) >= pipeline.parameters.spectral.dimensions + 2
    assert pipeline.match(made, made).cc == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("setting", SETTINGS)
def test_a_mesh_without_an_area_is_refused(setting):
    with pytest.raises(DegenerateMeshError):
        Pipeline(SETTINGS[setting]).embed(Mesh([[0, 0, 0], [1, 1, 1], [3, 3, 3]], [[0, 1, 2]]))


def test_a_mesh_above_the_limit_is_simplified_and_one_below_is_not():
    wanted = DEFAULT.with_values(
        mesh={"refine_vertices": 0, "decimate_above": 1000, "decimate_to": 600, "refine_simplified": 0}
    )
    pipeline = Pipeline(wanted)
    large, small = blob(subdivisions=4), blob(subdivisions=3)
    assert 540 <= len(prepared(large, pipeline.parameters)[0].vertices) <= 660
    assert len(prepared(small, pipeline.parameters)[0].vertices) == len(small.vertices)
    kept = prepared(large, wanted.with_values(mesh={"decimate_above": 0}))[0]
    assert len(kept.vertices) == len(large.vertices)
    made = pipeline.embed(large)
    assert made.facts.vertices == len(large.vertices)
    assert to_surface(made.positions, large).max() < 0.02 * made.facts.scale
    assert pipeline.score(made, [pipeline.embed(small)]).cc[0] > 0.95


def test_a_soup_of_triangles_keeps_them_up_to_a_limit_of_its_own():
    triangles = make_soup(make_shape("octopus", 0), 0.02, 0)
    mesh = DEFAULT.mesh
    assert mesh.decimate_above < len(triangles.vertices) < mesh.decimate_pieces_above
    bounded = DEFAULT.with_values(mesh={"decimate_pieces_above": 0})
    (kept, cleaned, frame, _), (simplified, *_) = (prepared(triangles, each) for each in (DEFAULT, bounded))
    given = face_areas(frame.apply(cleaned.mesh.vertices), cleaned.mesh.faces).sum()
    area, left = (face_areas(surface.vertices, surface.faces).sum() for surface in (kept, simplified))
    assert area == pytest.approx(given, rel=1e-9)
    assert left < 0.8 * area


def test_the_long_edges_of_a_simplified_mesh_are_split():
    """The flat sides of a box need few vertices, but samples are spread over them."""
    cut = refine(box(4, 2, 1), 9000)
    for even in (0, 3000):
        pipeline = Pipeline(
            DEFAULT.with_values(mesh={"decimate_to": 600, "refine_simplified": even, "refine_vertices": 0})
        )
        surface = prepared(cut, pipeline.parameters).surface
        edges = np.unique(np.sort(surface.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
        longest = np.linalg.norm(np.diff(surface.vertices[edges], axis=1), axis=2).max()
        # The bound of `core.mesh.subdivision.refine`.
        area = face_areas(surface.vertices, surface.faces).sum()
        assert (longest <= 1.5 * np.sqrt(2 * area / (np.sqrt(3) * 3000))) == bool(even)


def test_a_pipeline_can_be_sent_to_another_process():
    copied = pickle.loads(pickle.dumps(Pipeline(PAPER)))
    assert copied.fingerprint == PAPER.fingerprint


def test_views_of_a_noisy_mesh_are_near_to_the_clean_mesh_since_it_is_smoothed() -> None:
    mesh = make_shape("hand", 0)
    noisy = clean(add_noise(mesh, 0.01, 1)).mesh
    unsmoothed = view_descriptor(noisy.vertices, noisy.faces)
    views = np.stack([Pipeline().embed(noisy).descriptors["views"], unsmoothed])
    smoothed, direct = view_distance(Pipeline().embed(mesh).descriptors["views"], views)
    assert smoothed < 0.6 * direct
