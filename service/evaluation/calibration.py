"""The calibration of `combined`: labelled pairs in; models, and their errors on unseen classes, out.

Shapes made incomplete are queries to the clean shapes of their collection, in a pool of processes.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from core.arrays import Floats
from core.descriptors.network_views import is_available
from core.descriptors.registry import ShapeDescriptors, descriptors_of
from core.embedding import Embedding, Scores
from core.evaluation.calibration import BINS, LabelledPairs, Reliability, fit, leave_class_out, reliability
from core.evaluation.perturbation import cut_part, remove_discs
from core.evaluation.retrieval_measures import evaluate
from core.io import format_of, read_mesh
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.class_probability import (
    NETWORK_FEATURES,
    PART_FEATURES,
    features,
    isometry_bonus,
    part_features,
)
from core.ranking.differences import PairDifferences, differences_of
from core.ranking.local_density import DensitySample, LocalDensities, densities_in, density_sample
from service.console import counted, progress, say
from service.evaluation.pairwise_scores import (
    PairScores,
    embed_files,
    in_order,
    loaded,
    reason,
    stored,
    worker_pool,
)
from service.evaluation.retrieval import Files, labels_of, usable

Perturb = Callable[[Mesh, float, int], Mesh]
"""A function of a mesh, an amount and a seed, as in `core.evaluation.perturbation`."""

UPPER = 1
"""The first bin of pairs whose class probability exceeds 0.1: most of the others clearly have two classes."""

LEVELS: list[tuple[Perturb, float]] = [
    (perturb, amount) for perturb in (remove_discs, cut_part) for amount in (0.1, 0.2, 0.3, 0.4)
]
"""Perturbations that make shapes incomplete, and the shares of the area that they remove."""

DIGITS = 4
"""Decimals of the constants that the command prints."""


@dataclass(frozen=True, eq=False)
class ScoredQuery:
    """A perturbed shape and its embedding, and its scores and differences to each embedding of the gallery.

    The differences have the local densities among the gallery.
    """

    pipeline: Pipeline
    mesh: Mesh
    query: Embedding
    gallery: list[Embedding]
    scores: Scores
    differences: PairDifferences


def perturbed_query(
    embeddings: Path, perturb: Perturb, amount: float, seed: int, path: Path
) -> ScoredQuery | str:
    """Return a perturbed file as a query, or the reason why it cannot be one.

    `embeddings` is the file of a gallery's embeddings by `service.evaluation.pairwise_scores.stored`. In a
    run, by its `seed`, each file has its own random numbers, which depend on its name.
    """
    pipeline, (gallery, described, sample, densities) = _pipeline(), _load(embeddings)
    try:
        cleaned = clean(read_mesh(path.read_bytes(), format_of(path.name))).mesh
        mesh = perturb(cleaned, amount, seed_of(path, seed))
        query = pipeline.embed(mesh)
        scores = pipeline.score(query, gallery)
        descriptors = descriptors_of(query)
        density = densities_in(sample, [descriptors])
        differences = differences_of(descriptors, described, scores, density, densities)
        return ScoredQuery(pipeline, mesh, query, gallery, scores, differences)
    except Exception as error:
        return reason(error)


def seed_of(path: Path, seed: int) -> int:
    """Return the seed of one shape in one run, which depends on the name of its file alone."""
    return int(np.random.SeedSequence([seed, crc32(path.name.encode())]).generate_state(1)[0])


@lru_cache(maxsize=1)
def _pipeline() -> Pipeline:
    return Pipeline(DEFAULT)


@lru_cache(maxsize=1)
def _load(path: Path) -> tuple[list[Embedding], list[ShapeDescriptors], DensitySample, LocalDensities]:
    """Return the embeddings of a gallery, their descriptors, a sample of these, and their densities in it."""
    embeddings: list[Embedding] = loaded(path)
    descriptors = [descriptors_of(embedding) for embedding in embeddings]
    sample = density_sample(descriptors)
    return embeddings, descriptors, sample, densities_in(sample, descriptors)


def part_pairs(files: Files, workers: int | None) -> list[LabelledPairs]:
    """Return for each of `LEVELS` the features of shapes that look incomplete after it and of clean ones."""
    levels = []
    with worker_pool(DEFAULT, workers) as pool, progress() as bar:
        done = counted(bar, "embedding", len(files))
        files, embeddings = usable(files, embed_files(pool, [path for path, _ in files], done))
        count, labels = len(files), tuple(labels_of(files))
        done = counted(bar, "incomplete queries", count * len(LEVELS))
        with stored(embeddings) as path:
            for perturb, amount in LEVELS:
                pairs, asked = (
                    np.zeros((count, count, PART_FEATURES + _more())),
                    np.zeros((count, count), dtype=bool),
                )
                query = partial(_part_features, path, perturb, amount)
                for i, row in enumerate(in_order(pool, query, [path for path, _ in files], done)):
                    if isinstance(row, str):
                        say(f"{files[i][0]}, {perturb.__name__} {100 * amount:g} %: {row}")
                    elif row is not None:
                        pairs[i], asked[i] = row, True
                levels.append(LabelledPairs(labels, pairs, asked, weight=1.0 / len(LEVELS)))
    return levels


def _part_features(embeddings: Path, perturb: Perturb, amount: float, path: Path) -> Floats | str | None:
    """Return features of a perturbed file and of the gallery, shape (n, p); None if it looks complete."""
    asked = perturbed_query(embeddings, perturb, amount, 0, path)
    if isinstance(asked, str):
        return asked
    if not asked.differences.part.all():
        return None
    return part_features(asked.differences, network=is_available())


def _more() -> int:
    """Return the number of features that the extra `views` adds."""
    return NETWORK_FEATURES if is_available() else 0


def _plain(pairs: Sequence[LabelledPairs]) -> list[LabelledPairs]:
    """Return the pairs without the features that the extra `views` adds."""
    return [replace(some, features=some.features[..., : some.features.shape[-1] - _more()]) for some in pairs]


def study(
    names: Sequence[str],
    scored: Sequence[tuple[Sequence[str], PairScores]],
    perturbed: Sequence[LabelledPairs],
) -> dict[str, Any]:
    """Fit the models to all pairs, and judge each class by models fitted without it.

    `scored` has the labels and the pairs of each of the named collections, `perturbed` the `part_pairs` of
    all. Raise ParameterError if without one of the classes all pairs have the same label.

    Return the object that `--json` prints: the model of complete pairs; `incomplete`, the model of pairs with
    an incomplete shape, and how it judges shapes made incomplete; `plain` and `plain_incomplete`, both models
    without the features of a network, equal to the others where it is not installed; `together`, over all
    collections, each with the same weight; `collections`, by both models, each for its pairs. NN, FT and ST
    are those of the ranking by these probabilities; of incomplete shapes NN alone, by which the most probable
    whole shape, except their own, is of their class.
    """
    complete, incomplete = [], []
    for labels, scores in scored:
        differences, part = scores.differences, scores.differences.part
        complete.append(
            LabelledPairs(
                tuple(labels),
                features(differences, network=is_available()),
                ~part,
                isometry_bonus(differences),
            )
        )
        incomplete.append(
            LabelledPairs(tuple(labels), part_features(differences, network=is_available()), part)
        )
    of_complete = leave_class_out(complete)
    of_parts = leave_class_out([*incomplete, *perturbed])
    whole = [replace(pairs, asked=None) for pairs in complete]
    probabilities = [
        np.where(parts.both_ways, of_part, of_whole)
        for parts, of_part, of_whole in zip(incomplete, of_parts, of_complete, strict=False)
    ]
    collections = []
    for name, pairs, probability in zip(names, whole, probabilities, strict=True):
        measures = evaluate(probability, pairs.labels, larger_is_closer=True)
        about = {"name": name, "shapes": len(pairs.labels), "classes": len(set(pairs.labels))}
        about |= {measure: getattr(measures, measure) for measure in ("nn", "ft", "st")}
        collections.append(about | _numbers(reliability([pairs], [probability])))
    of_perturbed = of_parts[len(incomplete) :]
    right = _first_right(perturbed, of_perturbed)
    queries = {"queries": len(right), "nn": float(np.mean(right))}
    return {
        **asdict(fit(complete)),
        "incomplete": {
            **asdict(fit([*incomplete, *perturbed])),
            **queries,
            **_numbers(reliability(perturbed, of_perturbed)),
        },
        "plain": asdict(fit(_plain(complete))),
        "plain_incomplete": asdict(fit(_plain([*incomplete, *perturbed]))),
        "together": _numbers(reliability(whole, probabilities)),
        "collections": collections,
    }


def _first_right(perturbed: Sequence[LabelledPairs], probabilities: Sequence[Floats]) -> list[bool]:
    """Return for each query whether the most probable whole shape is of its class."""
    right: list[bool] = []
    for collection, probability in zip(perturbed, probabilities, strict=True):
        codes, pairs = collection.codes, collection.both_ways
        asked = np.flatnonzero(pairs.any(axis=1))
        first = np.where(pairs, probability, -1.0).argmax(axis=1)
        right += (codes[first[asked]] == codes[asked]).tolist()
    return right


def _numbers(judged: Reliability) -> dict[str, object]:
    errors = {"error": judged.error, "error_upper": judged.error_above(UPPER)}
    diagram = {key: np.asarray(getattr(judged, key)).tolist() for key in ("share", "said", "found")}
    return {"base_rate": judged.base_rate, **errors, **diagram}


def summary(judged: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Return headings, a row for all collections together, one for each, and one for incomplete shapes."""
    formats = {"name": "", "shapes": "", "classes": "", "base_rate": ".3f", "error": ".4f"}
    formats |= dict.fromkeys(("error_upper", "nn", "ft", "st"), ".3f")
    headings = ["collection", "shapes", "classes", "base rate", "error", f"error above {UPPER / BINS:g}"]
    together = {"name": "all together", **judged["together"]}
    parts = {"name": "incomplete shapes", "shapes": judged["incomplete"]["queries"], **judged["incomplete"]}
    rows = [
        [format(row[key], form) if key in row else "" for key, form in formats.items()]
        for row in (together, *judged["collections"], parts)
    ]
    return [*headings, "NN", "FT", "ST"], rows


def constants(judged: Mapping[str, Any]) -> str:
    """Return the assignments that `core/ranking/class_probability.py` holds."""
    lines = []
    models = {"PLAIN_POOL": judged["plain"], "PLAIN_PARTS": judged["plain_incomplete"]}
    if is_available():
        models |= {"POOL": judged, "PARTS": judged["incomplete"]}
    for name, model in models.items():
        slopes = ", ".join(f"{slope:.{DIGITS}f}" for slope in model["slopes"])
        slopes += "," if len(model["slopes"]) == 1 else ""
        lines.append(
            f"CALIBRATED_{name} = Calibration(intercept={model['intercept']:.{DIGITS}f}, slopes=({slopes}))"
        )
    return "\n".join(lines)
