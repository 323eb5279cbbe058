"""`isoshape calibrate`, against the fit to scores asked pair by pair."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.arrays import Floats
from core.descriptors.registry import descriptors_of
from core.embedding import Embedding
from core.evaluation.calibration import LabelledPairs, fit, leave_class_out, reliability
from core.evaluation.retrieval_measures import evaluate
from core.io import format_of, read_mesh
from core.mesh.cleaning import clean
from core.parameters import DEFAULT, INCOMPLETE
from core.pipeline import Pipeline
from core.ranking.class_probability import (
    NETWORK_FEATURES,
    PART_FEATURES,
    Calibration,
    features,
    isometry_bonus,
    part_features,
)
from core.ranking.differences import PairDifferences, differences_of
from core.ranking.local_density import (
    ENOUGH,
    TYPICAL_NETWORK,
    TYPICAL_SPECTRAL,
    TYPICAL_VIEW,
    densities_in,
    density_sample,
)
from service.datasets import read_collection
from service.evaluation import calibration
from service.evaluation.calibration import seed_of
from service.evaluation.retrieval import spread
from tests.service.cli.conftest import Run, mesh_bytes

LEVELS = calibration.LEVELS[2::4]


@pytest.fixture(autouse=True)
def one_amount(monkeypatch: pytest.MonkeyPatch) -> None:
    """One amount of each kind that leaves a part."""
    monkeypatch.setattr(calibration, "LEVELS", LEVELS)


def densities(distances: Floats, typical: float) -> Floats:
    """The distance of each of n shapes to its seventh neighbour, or to the last, shape (n,)."""
    others = len(distances) - 1
    nearest = np.sort(distances, axis=1)[:, min(7, others)]
    weight = min(1.0, others / ENOUGH)
    return np.asarray(nearest**weight * typical ** (1.0 - weight))


def differences(pipeline: Pipeline, one: Embedding, other: Embedding) -> PairDifferences:
    """The differences of one pair, without densities."""
    return differences_of(descriptors_of(one), [descriptors_of(other)], pipeline.score(one, [other]))


def plain(folder: Path) -> LabelledPairs:
    """All pairs of a folder, one at a time."""
    pipeline = Pipeline(DEFAULT)
    files = read_collection(folder)
    embeddings = [pipeline.embed(read_mesh(path.read_bytes(), format_of(path.name))) for path, _ in files]
    pairs = [[differences(pipeline, one, other) for other in embeddings] for one in embeddings]
    spectral, views, seen = (
        densities(np.array([[distance(pair)[0] for pair in row] for row in pairs]), typical)
        for distance, typical in (
            (lambda pair: pair.spectral, TYPICAL_SPECTRAL),
            (lambda pair: pair.distances["views"], TYPICAL_VIEW),
            (lambda pair: pair.distances["network_views"], TYPICAL_NETWORK),
        )
    )
    found = np.zeros((len(files), len(files), 14 + NETWORK_FEATURES))
    offsets = np.zeros((len(files), len(files)))
    for i, row in enumerate(pairs):
        for j, pair in enumerate(row):
            dense = replace(
                pair,
                spectral_density=np.sqrt(spectral[i] * spectral[j])[None],
                view_density=np.sqrt(views[i] * views[j])[None],
                network_density=np.sqrt(seen[i] * seen[j])[None],
            )
            found[i, j], offsets[i, j] = features(dense, network=True)[0], isometry_bonus(dense)[0]
    return LabelledPairs(tuple(label for _, label in files), found, offsets=offsets)


def plain_parts(folder: Path, count: int) -> list[LabelledPairs]:
    """Shapes made incomplete in every way, and the whole ones, one pair at a time."""
    pipeline = Pipeline(DEFAULT)
    files = spread(read_collection(folder), count)
    meshes = [clean(read_mesh(path.read_bytes(), format_of(path.name))).mesh for path, _ in files]
    wholes = [pipeline.embed(mesh) for mesh in meshes]
    described = [descriptors_of(whole) for whole in wholes]
    sample = density_sample(described)
    around = densities_in(sample, described)
    found = []
    for perturb, amount in LEVELS:
        told, asked = (
            np.zeros((count, count, PART_FEATURES + NETWORK_FEATURES)),
            np.zeros((count, count), dtype=bool),
        )
        for i, (path, _) in enumerate(files):
            query = pipeline.embed(perturb(meshes[i], amount, seed_of(path, 0)))
            if query.facts.boundary_ratio <= INCOMPLETE:
                continue
            asked[i] = True
            own = densities_in(sample, [descriptors_of(query)])
            for j, other in enumerate(wholes):
                pair = replace(
                    differences(pipeline, query, other),
                    spectral_density=np.sqrt(own.spectral * around.spectral[j]),
                    view_density=np.sqrt(own.view * around.view[j]),
                    network_density=np.sqrt(own.network * around.network[j]),
                )
                told[i, j] = part_features(pair, network=True)[0]
        labels = tuple(label for _, label in files)
        found.append(LabelledPairs(labels, told, asked, weight=1.0 / len(LEVELS)))
    return found


@pytest.fixture(scope="module")
def second(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two more classes, one of them the first collection's under another name's case."""
    folder = tmp_path_factory.mktemp("second") / "more"
    for label, name in (("cup", "Cup"), ("fish", "fish")):
        (folder / name).mkdir(parents=True)
        for pose in range(3, 5):
            (folder / name / f"{pose}.off").write_bytes(mesh_bytes(label, pose))
    return folder


@pytest.mark.studies
def test_the_fit_and_how_it_is_judged(collection: Path, second: Path, run: Run) -> None:
    done = run("calibrate", collection, second, "--parts", 9, "--json")
    assert (done.status, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    collections = [plain(collection), plain(second)]
    model = fit(collections)
    assert found["intercept"] == pytest.approx(model.intercept, rel=1e-3)
    assert found["slopes"] == pytest.approx(model.slopes, rel=1e-3)
    incomplete = [*plain_parts(collection, 9), *plain_parts(second, 4)]
    assert found["incomplete"]["queries"] == sum(one.both_ways.any(axis=1).sum() for one in incomplete) > 20
    part = fit(incomplete)
    assert found["incomplete"]["intercept"] == pytest.approx(part.intercept, rel=1e-3)
    assert found["incomplete"]["slopes"] == pytest.approx(part.slopes, rel=1e-3)
    judged = reliability(incomplete, leave_class_out(incomplete))
    assert found["incomplete"]["error"] == pytest.approx(judged.error, abs=1e-4)
    chances = leave_class_out(collections)
    for told, one, given, name in zip(
        found["collections"], collections, chances, ("made", "more"), strict=True
    ):
        figures = evaluate(given, one.labels, larger_is_closer=True)
        assert (told["name"], told["shapes"], told["classes"]) == (
            name,
            len(one.labels),
            len(set(one.labels)),
        )
        assert [told[key] for key in ("nn", "ft", "st")] == [figures.nn, figures.ft, figures.st]
        assert told["error"] == pytest.approx(reliability([one], [given]).error, abs=1e-4)
    assert found["together"]["base_rate"] == pytest.approx((9 / 36 + 2 / 6) / 2)


def test_too_few_classes_and_files_that_cannot_be_used(run: Run, tmp_path: Path) -> None:
    for label in ("cup", "pliers"):
        (tmp_path / label).mkdir()
        for pose in range(2):
            (tmp_path / label / f"{pose}.off").write_bytes(mesh_bytes(label, pose))
    few = run("calibrate", tmp_path)
    assert few.status == 1
    assert few.stderr.splitlines()[-1] == (
        "isoshape: three classes or more are needed, two of them with two shapes or more"
    )
    (tmp_path / "octopus").mkdir()
    (tmp_path / "octopus" / "0.off").write_bytes(mesh_bytes("octopus", 0))
    (tmp_path / "octopus" / "bad.off").write_bytes(b"OFF\n")
    done = run("calibrate", tmp_path, "--limit", 9)
    assert done.status == 1
    assert done.stderr.splitlines()[-1] == "isoshape: 1 file could not be used"
    code = done.stdout[done.stdout.index("CALIBRATED_PLAIN_POOL") :]
    constants: dict[str, object] = {"Calibration": Calibration}
    exec(code, constants)
    sizes = {"PLAIN_POOL": 14, "PLAIN_PARTS": PART_FEATURES}
    sizes |= {"POOL": 14 + NETWORK_FEATURES, "PARTS": PART_FEATURES + NETWORK_FEATURES}
    for name, size in sizes.items():
        model = constants[f"CALIBRATED_{name}"]
        assert isinstance(model, Calibration)
        assert len(model.slopes) == size
