"""The confidence of dense correspondences against the truth: a reliability diagram, and its fit.

    python -m tests.studies.confidence DIR [--limit 14] [--vertices 1500] [--individuals 4] [--tosca TOSCA]

Pairs of made bodies: another pose on another mesh, other individuals, a part of 50 to 90 % of the area and
the whole, and the whole and a part. With --tosca, as many pairs of a collection with `.vts` files as well.
For each kind and tenth of confidence, `confidence.csv` has the share of vertices within 0.05 of the true
partner; `differences.csv` has the mean difference of the two by kind, and `fit.csv` the coefficients of
`core.dense.confidence` that these pairs give. Exits with status 1
if confidence and share differ by more than 0.1 in the mean over all vertices.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from core.arrays import Floats, Ints
from core.dense.confidence import NEAR_TRUTH, agreement, distortion
from core.embedding import Embedding
from core.evaluation.correspondence_errors import drawn_pairs, surface_distances
from core.gallery import CLASSES
from core.gallery.bodies import individual_partners, make_body
from core.mesh.cleaning import face_areas, vertex_areas
from core.mesh.mesh import Mesh
from core.pipeline import Pipeline
from service.evaluation.template_truth import known_of, read_truth
from tests.studies.common import run, write

MOST, DRAWN = 0.1, 400
BINS = np.linspace(0.0, 1.0, 11)
PIPELINE = Pipeline()

Truth = Callable[[Ints], Floats]
Pair = tuple[str, Mesh, Mesh, Truth]


def part_of(mesh: Mesh, share: float, seed: int) -> tuple[Mesh, Ints]:
    """Return a mesh without a share of its area on one side, and the vertices of the mesh that it keeps."""
    along = np.random.default_rng(seed).normal(size=3)
    order = np.argsort(mesh.vertices[mesh.faces].mean(axis=1) @ along)
    areas = face_areas(mesh.vertices, mesh.faces)[order]
    faces = mesh.faces[np.sort(order[np.cumsum(areas) > share * areas.sum()])]
    kept, numbers = np.unique(faces, return_inverse=True)
    return Mesh(mesh.vertices[kept], numbers.reshape(-1, 3)), kept


def made_pairs(limit: int, vertices: int, individuals: int) -> Iterator[Pair]:
    """Yield pairs of bodies, with the errors of a map from the first to the second."""
    for number, label in enumerate(list(CLASSES)[:limit]):
        one, finer = (make_body(label, 0, vertices=count) for count in (vertices, round(1.2 * vertices)))
        posed, whole = one.posed(0), one.posed(1)
        yield "pose", posed, finer.posed(1), _errors(surface_distances(finer), one.partners(finer)[0])
        for body in range(1, individuals + 1):
            other = make_body(label, body, vertices=vertices)
            truth = individual_partners(one, other)[0]
            yield "individual", posed, other.posed(body + 1), _errors(surface_distances(other), truth)
        distances = surface_distances(one)
        part, kept = part_of(whole, 0.1 + 0.1 * (number % 5), number)
        yield "part and whole", part, posed, _errors(distances, kept)
        there = np.full(len(posed.vertices), -1)
        there[kept] = np.arange(len(kept))
        yield "whole and part", posed, part, _errors_on_part(distances, kept, there)


def _errors(distances: Floats, truth: Ints) -> Truth:
    return lambda found: distances[found, truth]


def _errors_on_part(distances: Floats, kept: Ints, there: Ints) -> Truth:
    everywhere = np.arange(len(there))
    return lambda found: np.where(there < 0, np.inf, distances[kept[found], everywhere])


@lru_cache(maxsize=8)
def _embedded(mesh: Mesh) -> Embedding:
    return PIPELINE.embed(mesh)


def judged(first: Mesh, second: Mesh, truth: Truth) -> tuple[Floats, Floats, Floats]:
    """Return confidence, features and whether the partner is right, of some vertices of the first mesh."""
    found = PIPELINE.surface_map(first, second, (_embedded(first), _embedded(second)))
    surface, (ours, theirs) = found.surfaces[0], found.rows
    way = found.correspondences()[0]
    agreements = agreement(ours, theirs[found.partners[0].vertices])[surface.nearest]
    errors = truth(way.vertices)
    chosen = np.random.default_rng(0).permutation(np.flatnonzero(~np.isnan(errors)))[:DRAWN]
    right = (errors <= NEAR_TRUTH).astype(np.float64)
    # Rigid copies, symmetric shapes and places without a partner are judged otherwise.
    of_map = way.partnered & (way.displacement is None and way.maps == 1)
    meshes = [each.mesh for each in found.surfaces]
    areas = [vertex_areas(mesh.vertices, mesh.faces) for mesh in meshes]
    distorted = distortion([each.stretch for each in found.partners], areas)
    features = np.column_stack([agreements, np.full((len(agreements), 2), (found.cost, distorted))])
    return (
        way.confidence[chosen].astype(np.float64),
        np.where(of_map[:, None], features, np.nan)[chosen],
        right[chosen],
    )


def diagram(kind: str, confidence: Floats, right: Floats) -> list[dict[str, Any]]:
    """Return a row for each tenth of confidence that has vertices."""
    tenth = np.clip(np.digitize(confidence, BINS) - 1, 0, 9)
    return [
        {
            "kind": kind,
            "from": BINS[each],
            "vertices": int((tenth == each).sum()),
            "confidence": confidence[tenth == each].mean(),
            "right": right[tenth == each].mean(),
        }
        for each in np.unique(tenth)
    ]


def known_pairs(collection: Path, limit: int) -> Iterator[Pair]:
    """Yield pairs of one class of a collection, with errors at vertices of the template; NaN elsewhere."""
    files = read_truth(collection)
    same, _ = drawn_pairs([str(f.label) for f in files], [str(f.template) for f in files], limit, 0)
    for i, j in same:
        first, second = (known_of(files[which].path, 0) for which in (i, j))
        yield collection.name, first.mesh, second.mesh, _errors_at(first.truth[0], second.distances[0])


def _errors_at(vertices: Ints, distances: Floats) -> Truth:
    def errors(found: Ints) -> Floats:
        told = np.full(len(found), np.nan)
        told[vertices] = distances[np.arange(len(vertices)), found[vertices]]
        return told

    return errors


def fitted(tables: Sequence[Sequence[Floats]]) -> Floats:
    """Return the coefficients of a logistic regression, the intercept first (maximum likelihood).

    Each table has columns as of `judged`; all tables count alike.
    """
    known = [(features, right) for _, features, right in tables if np.isfinite(features).any()]
    told = [np.isfinite(features).all(axis=1) for features, _ in known]
    kept = [(features[rows], right[rows]) for (features, right), rows in zip(known, told, strict=True)]
    features, right = (np.concatenate(column) for column in zip(*kept, strict=True))
    counts = np.concatenate([np.full(len(each), 1.0 / len(each)) for _, each in kept]) / len(kept)
    design = np.column_stack([np.ones(len(right)), features])

    def loss(weights: Floats) -> float:
        scores = design @ weights
        return float(counts @ (np.logaddexp(0.0, scores) - right * scores))

    return np.asarray(minimize(loss, np.zeros(design.shape[1]), method="Powell").x)


def main(folder: Path, limit: int, vertices: int, individuals: int, tosca: Path | None) -> bool:
    """Measure, and write both tables."""
    found: dict[str, list[tuple[Floats, Floats, Floats]]] = {}
    pairs = made_pairs(limit, vertices, individuals)
    for kind, first, second, truth in pairs if tosca is None else chain(pairs, known_pairs(tosca, limit)):
        found.setdefault(kind, []).append(judged(first, second, truth))
    tables = {
        kind: [np.concatenate(column) for column in zip(*each, strict=True)] for kind, each in found.items()
    }
    confidence, _, right = (np.concatenate(column) for column in zip(*tables.values(), strict=True))
    rows = [row for kind, (sure, _, known) in tables.items() for row in diagram(kind, sure, known)]
    together = diagram("all", confidence, right)
    write(folder / "confidence.csv", rows + together)
    names = "intercept", "agreement", "cost", "distortion"
    write(folder / "fit.csv", [dict(zip(names, fitted(list(tables.values())), strict=True))])
    off = {kind: _difference([row for row in rows if row["kind"] == kind]) for kind in tables}
    off["all"] = _difference(together)
    write(folder / "differences.csv", [off])
    return off["all"] <= MOST


def _difference(rows: list[dict[str, Any]]) -> float:
    """Return how much confidence and share differ in the mean over all vertices of a diagram."""
    gaps = [abs(row["confidence"] - row["right"]) for row in rows]
    return float(np.average(gaps, weights=[row["vertices"] for row in rows]))


if __name__ == "__main__":
    run(main, __doc__, limit=len(CLASSES), vertices=1500, individuals=4, tosca=Path)
