"""Records: an embedding to bytes and back, and bytes that are none."""

import json
from dataclasses import asdict, fields, replace

import numpy as np
import pytest
import zstandard
from safetensors.numpy import load, save

from core import serialization
from core.descriptors.facts import intrinsic_reliability
from core.descriptors.network import FEATURES
from core.descriptors.network_views import VIEWS
from core.descriptors.partial import ROW_LENGTH
from core.descriptors.registry import DESCRIPTORS, descriptors_of
from core.descriptors.spin_images import KEYPOINTS
from core.descriptors.views import VIEW_BYTES
from core.embedding import NO_ORIENTATION, Embedding, Spectrum
from core.errors import BadRecordError
from core.matching.match_records import match_record, match_record_of_points
from core.matching.quantised_points import rounded
from core.parameters import DEFAULT, PAPER
from core.pipeline import Pipeline
from core.serialization import (
    descriptors_from_bytes,
    embedding_from_bytes,
    embedding_to_bytes,
    points_from_bytes,
)
from core.spectral.spectral_embedding import SPECTRUM
from tests.core.shapes import FACTS as CLOSED
from tests.core.shapes import blob

FACTS = replace(
    CLOSED, components=2, merged_vertices=7, dropped_faces=1, nonmanifold_edges=4, boundary_ratio=0.25
)


def embedding(*, samples=12, spectra=2, seed=0):
    rng = np.random.default_rng(seed)
    edges = np.stack([np.arange(samples - 1), np.arange(1, samples)], axis=1).astype(np.int32)
    regions = np.arange(2 * samples, dtype=np.int32) % samples
    return Embedding(
        fingerprint="0123456789abcdef",
        facts=FACTS,
        positions=rng.normal(size=(samples, 3)).astype(np.float32),
        vertices=rng.permutation(FACTS.vertices)[:samples].astype(np.int32),
        graph_edges=np.concatenate([edges, [[0, samples - 1]]]).astype(np.int32),
        graph_lengths=rng.random(samples).astype(np.float32),
        tree_edges=edges,
        regions=regions,
        signature=rng.random(9).astype(np.float32),
        spectra=tuple(
            Spectrum(
                name,
                rng.random(5 + i).astype(np.float32),
                rounded(rng.normal(size=(2 * samples, 4 + i)).astype(np.float32), regions),
            )
            for i, name in enumerate(("affinity", "laplace-beltrami")[:spectra])
        ),
        pieces=rng.random((2, 6)).astype(np.float32),
        descriptors={
            "spin_images": rng.integers(0, 255, size=(KEYPOINTS, ROW_LENGTH)).astype(np.uint8),
            "views": rng.integers(0, 255, size=VIEW_BYTES).astype(np.uint8),
            "eigenvalues": np.sort(rng.random(SPECTRUM)).astype(np.float16),
            "network_views": rng.integers(-127, 128, size=(VIEWS, FEATURES)).astype(np.int8),
        },
        # Of the five Laplace-Beltrami coordinates.
        orientation=rng.integers(-127, 128, size=(samples, 10)).astype(np.int8)
        if spectra == 2
        else NO_ORIENTATION,
    )


ARRAYS = [
    field.name
    for field in fields(Embedding)
    if field.name not in ("fingerprint", "facts", "spectra", "descriptors")
]
BESIDE = [name for name in ARRAYS if name != "regions"]
"""The arrays that are not in the quantised points."""


@pytest.mark.parametrize("spectra", [1, 2])
def test_an_embedding_comes_back_whole(spectra):
    made = embedding(spectra=spectra)
    back = embedding_from_bytes(embedding_to_bytes(made))
    assert back.fingerprint == made.fingerprint
    assert back.facts == made.facts
    for name in ARRAYS:
        assert getattr(back, name).dtype == getattr(made, name).dtype
        assert np.array_equal(getattr(back, name), getattr(made, name))
    for name in DESCRIPTORS:
        assert back.descriptors[name].dtype == made.descriptors[name].dtype
        assert np.array_equal(back.descriptors[name], made.descriptors[name])
    assert [spectrum.name for spectrum in back.spectra] == [spectrum.name for spectrum in made.spectra]
    for one, other in zip(back.spectra, made.spectra, strict=True):
        assert one.eigenvalues.dtype == one.coordinates.dtype == np.float32
        assert np.array_equal(one.eigenvalues, other.eigenvalues)
        assert np.array_equal(one.coordinates, other.coordinates)


def test_the_same_embedding_gives_the_same_bytes():
    first = embedding_to_bytes(embedding())
    assert embedding_to_bytes(embedding()) == first
    assert embedding_to_bytes(embedding_from_bytes(first)) == first


def test_the_memory_layout_of_an_array_does_not_matter():
    made = embedding()
    turned = replace(made, positions=np.asfortranarray(made.positions))
    strided = replace(made, positions=np.repeat(made.positions, 2, axis=0)[::2])
    assert embedding_to_bytes(turned) == embedding_to_bytes(strided) == embedding_to_bytes(made)


def refused(data, match=None):
    with pytest.raises(BadRecordError, match=match):
        embedding_from_bytes(data)


def arrays_of(record):
    """The arrays of a record."""
    return {name: columns.T.copy() for name, columns in load(zstandard.decompress(record)).items()}


def saved(arrays):
    """The record of arrays, which are stored by columns."""
    return zstandard.compress(save({name: array.T.copy() for name, array in arrays.items()}))


def arrays_with(header=None, **others):
    """The record of an embedding with other arrays, or with another header of bytes or of changed values."""
    arrays = arrays_of(embedding_to_bytes(embedding())) | others
    if isinstance(header, dict):
        header = json.dumps(json.loads(arrays["header"].tobytes()) | header).encode()
    if header is not None:
        arrays["header"] = np.frombuffer(header, dtype=np.uint8)
    return arrays


def test_a_truncated_record_is_refused_wherever_it_ends():
    data = embedding_to_bytes(embedding())
    for end in (*range(0, len(data), 7), -1):
        refused(data[:end])


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"ply\nformat ascii 1.0\n",
        b"{}",
        b"\x02\x00\x00\x00\x00\x00\x00\x00{}",
        save({"weights": np.zeros((2, 3), dtype=np.float32)}),
        embedding_to_bytes(embedding()) + b"\x00",
        *(np.random.default_rng(seed).bytes(10 * 20**seed) for seed in range(3)),
    ],
)
def test_other_bytes_are_refused(data):
    refused(data)


def test_a_record_of_too_many_bytes_or_of_an_unknown_number_is_refused(monkeypatch):
    data = embedding_to_bytes(embedding())
    arrays = zstandard.decompress(data)
    refused(zstandard.ZstdCompressor(write_content_size=False).compress(arrays), "too large")
    monkeypatch.setattr(serialization, "MOST_BYTES", len(arrays) - 1)
    refused(data, "too large")


OPTIONAL = {"eigenvalues", "network_views"}


@pytest.mark.parametrize(
    "missing", ["header", "points", *BESIDE, *sorted(DESCRIPTORS.keys() - OPTIONAL), "eigenvalues_0"]
)
def test_a_record_without_one_of_its_arrays_is_refused(missing):
    arrays = arrays_with()
    del arrays[missing]
    refused(saved(arrays))
    if missing in ("header", "signature", *DESCRIPTORS):
        with pytest.raises(BadRecordError):
            descriptors_from_bytes(saved(arrays))


def test_the_embeddings_that_the_pipeline_makes_are_records():
    for parameters in (DEFAULT, PAPER):
        made = Pipeline(parameters).embed(blob(0, 2))
        back = embedding_from_bytes(embedding_to_bytes(made))
        assert embedding_to_bytes(back) == embedding_to_bytes(made)
        has_laplacian = "laplace-beltrami" in parameters.spectral.operators
        assert ("eigenvalues" in back.descriptors) == has_laplacian


def changed(name, change):
    return saved(arrays_with(**{name: np.array(change(arrays_with()[name].copy()), order="C")}))


def with_last(name, value):
    return changed(
        name, lambda array: np.append(array.ravel()[:-1], array.dtype.type(value)).reshape(array.shape)
    )


@pytest.mark.parametrize("name", [*BESIDE, *DESCRIPTORS, "eigenvalues_0"])
def test_an_array_of_another_type_or_shape_is_refused(name):
    other = {
        "float32": np.float64,
        "float16": np.float64,
        "int32": np.int64,
        "uint8": np.int16,
        "int8": np.int16,
    }
    refused(changed(name, lambda array: array.astype(other[array.dtype.name])), "float64|int64|int16")
    for change in (
        lambda array: array[None],
        lambda array: array[..., 0],
        lambda array: array[:0],
        lambda array: array.reshape(-1)[:1].reshape(()),
    ):
        refused(changed(name, change))


@pytest.mark.parametrize("name", sorted(set(BESIDE) - {"signature", "pieces"}))
def test_an_array_that_is_shorter_than_the_others_is_refused(name):
    refused(changed(name, lambda array: array[:-1]))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["positions", "graph_lengths", "signature", "eigenvalues_1"])
def test_a_number_that_is_not_finite_is_refused(name, value):
    refused(with_last(name, value), "not finite")


@pytest.mark.parametrize("index", [-1, 12, FACTS.vertices, 2**31 - 1])
@pytest.mark.parametrize("name", ["vertices", "graph_edges", "tree_edges"])
def test_an_index_of_nothing_is_refused(name, index):
    if name == "vertices" and 0 <= index < FACTS.vertices:
        embedding_from_bytes(with_last(name, index))
    else:
        refused(with_last(name, index), "out of range")


@pytest.mark.parametrize(
    "header",
    [
        *(b"", b"\xff\xfe", b"[]", b"null", b'"text"', b"{}"),
        *({"facts": facts, "spectra": []} for facts in ({}, {"colour": 1}, [])),
        *({"fingerprint": 7}, {"fingerprint": None}),
        *(
            {"spectra": names}
            for names in (
                [],
                ["affinity", "laplace-beltrami"],
                [["affinity", 4], ["affinity", 5]],
                [["affinity", 4], [["laplace-beltrami"], 5]],
                [["affinity", 4], ["laplace-beltrami", 4]],
                [["affinity", 10], ["laplace-beltrami", -1]],
            )
        ),
        *({"facts": {**asdict(FACTS), "area": area}} for area in (float("nan"), -1.0)),
        *({"facts": {**asdict(FACTS), "faces": faces}} for faces in (1.5, True)),
        {"facts": {**asdict(FACTS), "scale": "1"}},
        {"facts": {**asdict(FACTS), "components": -1}},
        {"facts": {**asdict(FACTS), "volume": float("inf")}},
        {"facts": {**asdict(FACTS), "boundary_edges": -1}},
        *({"facts": {**asdict(FACTS), name: 10**400}} for name in ("faces", "area")),
    ],
)
def test_a_header_that_is_not_one_or_has_a_value_of_the_wrong_kind_is_refused(header):
    data = saved(arrays_with(header))
    refused(data)
    if isinstance(header, bytes) or "facts" in header:
        with pytest.raises(BadRecordError):
            descriptors_from_bytes(data)


def test_descriptors_are_those_of_the_embedding():
    made = embedding()
    found, expected = descriptors_from_bytes(embedding_to_bytes(made)), descriptors_of(made)
    assert np.array_equal(found.signature, expected.signature)
    assert found.arrays.keys() == expected.arrays.keys() == DESCRIPTORS.keys()
    for name, array in found.arrays.items():
        assert np.array_equal(array, expected.arrays[name])
        assert array.dtype == expected.arrays[name].dtype
    assert found.reliability == intrinsic_reliability(FACTS)


@pytest.mark.parametrize("name", sorted(OPTIONAL))
def test_a_record_may_lack_an_optional_descriptor(name):
    arrays = arrays_with()
    del arrays[name]
    found = embedding_from_bytes(saved(arrays))
    assert found.descriptors.keys() == DESCRIPTORS.keys() - {name}
    assert embedding_from_bytes(embedding_to_bytes(found)).descriptors.keys() == found.descriptors.keys()
    assert descriptors_from_bytes(saved(arrays)).arrays.keys() == found.descriptors.keys()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("signature", np.zeros(9)),
        ("spin_images", np.zeros((KEYPOINTS + 1, ROW_LENGTH), np.uint8)),
        ("views", np.zeros(VIEW_BYTES - 1, np.uint8)),
        ("views", np.zeros(VIEW_BYTES, np.int8)),
        ("network_views", np.zeros((VIEWS, FEATURES - 1), np.int8)),
        ("network_views", np.zeros((VIEWS, FEATURES), np.uint8)),
        ("eigenvalues", np.zeros(SPECTRUM, np.float32)),
        ("eigenvalues", np.full(SPECTRUM, np.nan, np.float16)),
    ],
)
def test_descriptors_of_the_wrong_shape_or_type_are_refused(name, value):
    data = saved(arrays_with(**{name: value}))
    refused(data)
    with pytest.raises(BadRecordError):
        descriptors_from_bytes(data)


@pytest.mark.parametrize(("spectra", "columns"), [(2, 9), (1, 45)])
def test_an_orientation_of_other_coordinates_is_refused(spectra, columns):
    made = replace(embedding(spectra=spectra), orientation=np.zeros((12, columns), np.int8))
    refused(embedding_to_bytes(made), "orientation")


def test_the_points_of_a_record_give_the_match_record_of_its_embedding():
    made = Pipeline(DEFAULT).embed(blob(0, 3))
    data = embedding_to_bytes(made)
    record = match_record_of_points(points_from_bytes(data), DEFAULT)
    assert record.tobytes() == match_record(made, DEFAULT).tobytes()


def points_are_refused(data):
    with pytest.raises(BadRecordError):
        match_record_of_points(points_from_bytes(data), DEFAULT)


def test_points_of_a_truncated_record_are_refused():
    data = embedding_to_bytes(Pipeline(DEFAULT).embed(blob(0, 3)))
    for end in range(0, len(data), 97):
        points_are_refused(data[:end])


@pytest.mark.parametrize(
    "header",
    [
        b"{",
        {"spectra": []},
        {"spectra": 3},
        {"spectra": [["affinity", 4], ["laplace-beltrami", 5]]},
        {"fingerprint": DEFAULT.fingerprint, "spectra": [["affinity", 4]] * 5},
    ],
)
def test_points_of_spectra_that_are_none_are_refused(header):
    points_are_refused(saved(arrays_with(header)))


@pytest.mark.parametrize("points", [b"", b"\x00" * 12, b"\xff" * 400])
def test_bytes_that_are_no_points_are_refused(points):
    header = {"fingerprint": DEFAULT.fingerprint, "spectra": [["affinity", 3]] * 3}
    points_are_refused(saved(arrays_with(header, points=np.frombuffer(points, dtype=np.uint8))))
