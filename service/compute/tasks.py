"""The tasks of the workers: bytes in, bytes out. Called by reference in another process."""

import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, astuple, dataclass
from functools import lru_cache
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from core.arrays import Bytes, Float32s, Floats
from core.dense.transfer import Transferred, Wanted, transfer
from core.descriptors.facts import gyration_radii, intrinsic_reliability
from core.descriptors.network import FEATURES
from core.descriptors.network_views import VIEWS, network_view_distance
from core.descriptors.partial import describe_part
from core.descriptors.registry import EVERYWHERE
from core.descriptors.view_images import view_images
from core.descriptors.views import signature_distance, view_signature
from core.embedding import DenseCorrespondence, Embedding, Match, Scores
from core.errors import BadRecordError, CannotBeEmbeddedError, DegenerateMeshError
from core.graph.bridges import bridges
from core.io import Limits, read_file
from core.matching.match_records import example_match_records, match_record, score_match_records
from core.matching.matcher import matcher_of
from core.mesh.bounding_box import Sides, bounding_box, file_box
from core.mesh.box_tree import closest_on_triangles, triangle_tree
from core.mesh.mesh import Mesh
from core.mesh.preparation import MOST_IN_TREE, nearest_vertices
from core.mesh.simplification import contract_edges
from core.numerics.guarding import guarded
from core.parameters import Parameters
from core.pipeline import Pipeline
from core.ranking.class_probability import combined_scores
from core.ranking.isometry import isometry_distance
from core.ranking.likeness import least_bend
from core.ranking.reranking import coarse_samples, rerank
from core.ranking.shortlist import signature_distances
from core.registration.instances import Instances, instances
from core.registration.probed_surface import probed_surface
from core.registration.rigid_alignment import rigid_alignment
from core.registration.rigid_copy import RigidCopy, copy_by_surfaces
from core.registration.similarity import Similarity
from core.serialization import embedding_from_bytes, embedding_to_bytes
from service.rendering.thumbnail import SIZES, draw


@dataclass(frozen=True, eq=False)
class Embedded:
    """A file's embedding, ready to be stored.

    `record` is the whole embedding, with its `signature`, shape (s,). `core.ranking.reranking` describes
    `coarse_samples`, `core.descriptors.views` the `view_signature`, shape (v,),
    `core.descriptors.facts` the `reliability`, and `core.descriptors.pieces` the `pieces`. `facts` are those
    of the embedding, the bounding boxes and the warnings, by name, and `milliseconds` the wall times of the
    stages "read" and "embed".
    """

    record: bytes
    signature: NDArray[np.float32]
    coarse_samples: bytes
    view_signature: Bytes
    reliability: float
    pieces: Float32s
    facts: dict[str, Any]
    milliseconds: dict[str, float]


def embed_file(data: bytes, format: str, limits: Limits, parameters: Parameters) -> Embedded:
    """Read a file and embed its mesh; a MeshError tells by its subclass why the file cannot be used."""
    start = time.perf_counter()
    file = read_file(data, format, limits=limits)
    read = 1e3 * (time.perf_counter() - start)
    return embed_mesh(file.mesh, parameters, read, file.warnings)


def embed_mesh(
    mesh: Mesh,
    parameters: Parameters,
    read: float,
    warnings: Sequence[str] = (),
    descriptors: Iterable[str] | None = None,
) -> Embedded:
    """Embed a mesh that took `read` milliseconds to read, with the warnings of its reader.

    `descriptors` are those of `core.pipeline.Pipeline.embed`. A MeshError tells by its subclass why the mesh
    cannot be used.
    """
    start = time.perf_counter()
    with guarded():
        embedding = _pipeline(parameters).embed(mesh, descriptors)
        if not _is_finite(embedding):
            raise DegenerateMeshError(
                "the mesh has no finite embedding: its coordinates are too large, or its surface too thin"
            )
        embed = 1e3 * (time.perf_counter() - start)
        lengths = {
            "bounding_box": bounding_box(mesh),
            "file_box": file_box(mesh),
            "gyration_radii": gyration_radii(mesh),
        }
        return ready_to_store(embedding, lengths, {"read": read, "embed": embed}, warnings)


def ready_to_store(
    embedding: Embedding,
    lengths: Mapping[str, Sides],
    milliseconds: dict[str, float],
    warnings: Sequence[str] = (),
) -> Embedded:
    """Return an embedding with all that is stored beside it.

    `lengths` are the boxes and the radii of gyration by name.
    """
    return Embedded(
        record=embedding_to_bytes(embedding),
        signature=embedding.signature,
        coarse_samples=coarse_samples(embedding).tobytes(),
        view_signature=view_signature(embedding.descriptors["views"]),
        reliability=intrinsic_reliability(embedding.facts),
        pieces=embedding.pieces,
        facts={**asdict(embedding.facts), **lengths, "warnings": list(warnings)},
        milliseconds=milliseconds,
    )


def score_embeddings(query: bytes, records: Sequence[bytes], parameters: Parameters) -> Scores:
    """Return the scores of a query with each of c embedding records; NaN for a record that fails.

    The arrays have the shape (c,).
    """
    scores = Scores(*(np.full(len(records), np.nan) for _ in range(3)))
    candidates = {}
    for i, record in enumerate(records):
        with suppress(BadRecordError):
            candidates[i] = embedding_from_bytes(record)
    if candidates:
        _score(scores, _pipeline(parameters), embedding_from_bytes(query), candidates)
    return scores


def _score(scores: Scores, pipeline: Pipeline, query: Embedding, candidates: dict[int, Embedding]) -> None:
    """Set the scores of a query with candidates, by their indices; NaN remains where the method fails."""
    indices = list(candidates)
    try:
        matched = pipeline.score(query, list(candidates.values()))
    except CannotBeEmbeddedError:
        middle = len(indices) // 2
        for half in (indices[:middle], indices[middle:]) if middle else ():
            _score(scores, pipeline, query, {i: candidates[i] for i in half})
    else:
        scores.cc[indices], scores.ssd[indices], scores.sim[indices] = matched.cc, matched.ssd, matched.sim


def match_embeddings(first: bytes, second: bytes, parameters: Parameters) -> Match:
    """Match two embedding records."""
    return _pipeline(parameters).match(embedding_from_bytes(first), embedding_from_bytes(second))


def part_of_mesh(mesh: Mesh, parameters: Parameters) -> Bytes:
    """Return the spin images of a mesh taken as a part: `core.descriptors.partial.describe_part`."""
    with guarded():
        return describe_part(_pipeline(parameters).open_surface(mesh))


def registered(
    first: Mesh,
    second: Mesh,
    first_record: bytes,
    second_record: bytes,
    parameters: Parameters,
    variants: bool = True,
) -> RigidCopy | None:
    """Register the second mesh as a rigid copy of the first or, with `variants`, as a variant of it.

    See `core.registration.rigid_copy`.
    """
    with guarded():
        ends = _matched_points(first_record, second_record, parameters)
        return copy_by_surfaces(probed_surface(first), probed_surface(second), ends, variants=variants)


def instances_in(part: Mesh, whole: Mesh) -> Instances:
    """Count the pieces of a mesh that are copies of a part: `core.registration.instances.instances`."""
    with guarded():
        return instances(part, whole)


def aligned(
    first: Mesh, second: Mesh, first_record: bytes, second_record: bytes, parameters: Parameters
) -> Similarity | None:
    """Return the transform of the second mesh onto the first, of rigid parts that differ.

    See `core.registration.rigid_alignment`: it is None for bodies that bend.
    """
    with guarded():
        embeddings = embedding_from_bytes(first_record), embedding_from_bytes(second_record)
        ends = Pipeline(parameters).match(*embeddings).points(*embeddings)
        bent = least_bend(isometry_distance(*embeddings))
        found = rigid_alignment(probed_surface(first), probed_surface(second), ends, bent)
        return found and found.inverse


def _matched_points(
    first_record: bytes, second_record: bytes, parameters: Parameters
) -> tuple[Floats, Floats]:
    """Return the positions of the matched samples of two embedding records, shapes (m, 3)."""
    first, second = embedding_from_bytes(first_record), embedding_from_bytes(second_record)
    return Pipeline(parameters).match(first, second).points(first, second)


def dense_correspondence(
    first: Mesh,
    second: Mesh,
    first_record: bytes,
    second_record: bytes,
    parameters: Parameters,
    placing: Similarity | None,
    functions: int,
    landmarks: tuple[Floats, Floats] | None = None,
    wanted: Wanted | None = None,
) -> tuple[tuple[DenseCorrespondence, DenseCorrespondence], Transferred | None]:
    """Find the dense correspondence both ways, and transfer what is wanted by it.

    See `core.pipeline.Pipeline.surface_map` and `core.dense.transfer`. `placing` maps the second mesh onto
    the first, if it is registered.
    """
    embeddings = embedding_from_bytes(first_record), embedding_from_bytes(second_record)
    transform = placing and placing.inverse
    map_ = Pipeline(parameters).surface_map(
        first, second, embeddings, transform, functions=functions, landmarks=landmarks
    )
    with guarded():
        found = None if wanted is None else transfer(map_, wanted, landmarks)
        return map_.correspondences(), found


def correspondence_archive(way: DenseCorrespondence) -> bytes:
    """Return a correspondence as a NumPy archive (npz)."""
    arrays: dict[str, Any] = {
        "vertices": way.vertices,
        "confidence": way.confidence,
        "stretch": way.stretch,
        "partnered": way.partnered,
        "maps": np.int32(way.maps),
    }
    if way.displacement is not None:
        arrays["displacement"] = way.displacement
    file = BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


@lru_cache(maxsize=4)
def warm(parameters: Parameters) -> None:
    """Run each task once, so that all imports and compiled functions are loaded before the first request.

    It does nothing where this process, or the fork server that forked it, has done so before. Thread limits
    in the environment come too late for a library that the main module had loaded.
    """
    warm_surfaces(parameters)
    records = example_records(parameters)
    score_embeddings(records[0], records, parameters)
    warm_comparing(records, parameters)
    match_embeddings(records[0], records[1], parameters)
    threadpool_limits(1)


def warm_surfaces(parameters: Parameters) -> None:
    """Run the steps from a mesh to its embedding once, and the kernels of rare meshes and of registration.

    The network that sees views is loaded by `core.descriptors.network_views.session`, after the fork.
    """
    with guarded():
        for mesh in (_bumpy_sheet(), _ring()):
            _pipeline(parameters).embed(mesh, EVERYWHERE)
    draw(_bumpy_sheet(), "ply", SIZES[0])
    vertices, faces = _ring().vertices, _ring().faces
    view_images(vertices, faces, np.eye(3), SIZES[0])
    corners, first = vertices[faces], np.zeros((1, 1), dtype=np.int64)
    # Large meshes, and meshes of several pieces.
    contract_edges(vertices, faces, len(vertices) // 2)
    nearest_vertices(np.zeros((MOST_IN_TREE + 1, 3)), vertices)
    bridges(vertices, np.arange(len(vertices)) % 2)
    # Registration.
    closest_on_triangles(corners, first, vertices[:1])
    triangle_tree(corners).closest(vertices)


def warm_matching(parameters: Parameters) -> None:
    """Run the kernels of matching once, without an embedding: half of the time that compilation takes."""
    if not matcher_of(parameters).uses_match_records:
        return
    records = example_match_records(parameters)
    score_match_records(records[0], records, parameters)


def example_records(parameters: Parameters) -> list[bytes]:
    """Return two embedding records, of a surface with a boundary and of one without: their paths differ."""
    meshes = (_bumpy_sheet(), _ring())
    return [embed_mesh(mesh, parameters, 0.0, descriptors=EVERYWHERE).record for mesh in meshes]


def warm_comparing(records: Sequence[bytes], parameters: Parameters) -> None:
    """Run each kernel of a search once, in the process that searches."""
    embeddings = [embedding_from_bytes(record) for record in records]
    signature_distances(embeddings[0].signature, np.stack([one.signature for one in embeddings]))
    none = np.zeros(len(embeddings))
    for embedding in embeddings:
        combined_scores(embedding, embeddings, Scores(none, none, none))
    signatures = np.stack([view_signature(embedding.descriptors["views"]) for embedding in embeddings])
    signature_distance(signatures[0], signatures)
    views = np.zeros((len(embeddings), VIEWS, FEATURES), dtype=np.int8)
    network_view_distance(views[0], list(views))
    if matcher_of(parameters).uses_match_records:
        match_records = [match_record(embedding, parameters) for embedding in embeddings]
        score_match_records(match_records[0], match_records, parameters)
        samples = np.stack([coarse_samples(embedding) for embedding in embeddings])
        rerank(match_records[0], samples, parameters)


@lru_cache(maxsize=4)
def _pipeline(parameters: Parameters) -> Pipeline:
    return Pipeline(parameters)


def _is_finite(embedding: Embedding) -> bool:
    arrays = [embedding.positions, embedding.graph_lengths, embedding.signature]
    for spectrum in embedding.spectra:
        arrays += [spectrum.eigenvalues, spectrum.coordinates]
    return all(bool(np.isfinite(array).all()) for array in arrays) and bool(
        np.isfinite(np.array(astuple(embedding.facts), dtype=np.float64)).all()
    )


def _bumpy_sheet() -> Mesh:
    """Return a square grid of 14 by 14 vertices with hills, of no symmetry."""
    x, y = np.meshgrid(np.linspace(0, 1, 14), np.linspace(0, 1.3, 14), indexing="ij")
    z = 0.3 * np.sin(3 * x + y) * np.cos(4 * y * y)
    return _grid(np.stack([x, y, z], axis=-1), closed=False)


def _ring() -> Mesh:
    """Return a closed surface: a torus, thicker on one side."""
    long, short = np.meshgrid(*(2.0 * np.pi * np.arange(n) / n for n in (16, 10)), indexing="ij")
    thick = 0.3 + 0.1 * np.cos(long)
    far = 1.0 + thick * np.cos(short)
    return _grid(
        np.stack([far * np.cos(long), far * np.sin(long), thick * np.sin(short)], axis=-1), closed=True
    )


def _grid(points: Floats, *, closed: bool) -> Mesh:
    """Return the mesh of a grid of points, shape (u, v, 3); a closed one joins its opposite edges."""
    corner = np.arange(points[..., 0].size).reshape(points.shape[:2])
    if closed:
        corner = np.pad(corner, (0, 1), mode="wrap")
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=-1)
    return Mesh(points.reshape(-1, 3), faces.reshape(-1, 3))
