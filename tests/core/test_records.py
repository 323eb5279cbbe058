"""Records: an embedding to bytes and back, and bytes that are none."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest
from safetensors.numpy import load, save

from core.embedding import Embedding, Facts, Spectrum
from core.errors import BadRecordError
from core.records import embedding_from_bytes, embedding_to_bytes

FACTS = Facts(
    vertices=120,
    faces=236,
    area=3.25,
    volume=0.1,
    scale=1e-3,
    components=2,
    merged_vertices=7,
    dropped_faces=1,
    boundary_edges=0,
    nonmanifold_edges=4,
)


def embedding(*, samples=12, spectra=2, seed=0):
    rng = np.random.default_rng(seed)
    edges = np.stack([np.arange(samples - 1), np.arange(1, samples)], axis=1).astype(np.int32)
    return Embedding(
        fingerprint="0123456789abcdef",
        facts=FACTS,
        positions=rng.normal(size=(samples, 3)).astype(np.float32),
        vertices=rng.permutation(120)[:samples].astype(np.int32),
        graph_edges=np.concatenate([edges, [[0, samples - 1]]]).astype(np.int32),
        graph_lengths=rng.random(samples).astype(np.float32),
        tree_edges=edges,
        regions=np.arange(2 * samples, dtype=np.int32) % samples,
        signature=rng.random(9).astype(np.float32),
        spectra=tuple(
            Spectrum(
                name,
                rng.random(5 + i).astype(np.float32),
                rng.normal(size=(2 * samples, 4 + i)).astype(np.float32),
            )
            for i, name in enumerate(("affinity", "laplace-beltrami")[:spectra])
        ),
    )


ARRAYS = [field.name for field in fields(Embedding) if field.name not in ("fingerprint", "facts", "spectra")]


@pytest.mark.parametrize("spectra", [1, 2])
def test_an_embedding_comes_back_whole(spectra):
    made = embedding(spectra=spectra)
    back = embedding_from_bytes(embedding_to_bytes(made))
    assert back.fingerprint == made.fingerprint
    assert back.facts == made.facts
    for name in ARRAYS:
        assert getattr(back, name).dtype == getattr(made, name).dtype
        assert np.array_equal(getattr(back, name), getattr(made, name))
    assert [spectrum.name for spectrum in back.spectra] == [spectrum.name for spectrum in made.spectra]
    for one, other in zip(back.spectra, made.spectra, strict=True):
        assert one.eigenvalues.dtype == one.coordinates.dtype == np.float32
        assert np.array_equal(one.eigenvalues, other.eigenvalues)
        assert np.array_equal(one.coordinates, other.coordinates)


def test_the_same_embedding_gives_the_same_bytes():
    first = embedding_to_bytes(embedding())
    assert embedding_to_bytes(embedding()) == first
    assert embedding_to_bytes(embedding_from_bytes(first)) == first


def test_another_embedding_gives_other_bytes():
    made = embedding()
    assert embedding_to_bytes(embedding(seed=1)) != embedding_to_bytes(made)
    assert embedding_to_bytes(replace(made, fingerprint="f" * 16)) != embedding_to_bytes(made)
    assert embedding_to_bytes(replace(made, facts=replace(FACTS, components=3))) != embedding_to_bytes(made)


def test_how_an_array_lies_in_memory_does_not_matter():
    made = embedding()
    turned = replace(made, positions=np.asfortranarray(made.positions))
    strided = replace(made, positions=np.repeat(made.positions, 2, axis=0)[::2])
    assert embedding_to_bytes(turned) == embedding_to_bytes(strided) == embedding_to_bytes(made)


def test_no_bytes_are_no_record():
    with pytest.raises(BadRecordError):
        embedding_from_bytes(b"")


def test_a_truncated_record_is_refused_wherever_it_ends():
    data = embedding_to_bytes(embedding())
    for end in range(0, len(data), 7):
        with pytest.raises(BadRecordError):
            embedding_from_bytes(data[:end])
    with pytest.raises(BadRecordError):
        embedding_from_bytes(data[:-1])


def test_more_bytes_than_a_record_are_refused():
    with pytest.raises(BadRecordError):
        embedding_from_bytes(embedding_to_bytes(embedding()) + b"\x00")


@pytest.mark.parametrize("seed", range(20))
def test_random_bytes_are_refused(seed):
    rng = np.random.default_rng(seed)
    with pytest.raises(BadRecordError):
        embedding_from_bytes(rng.bytes(int(rng.integers(1, 4000))))


@pytest.mark.parametrize("data", [b"ply\nformat ascii 1.0\n", b"{}", b"\x02\x00\x00\x00\x00\x00\x00\x00{}"])
def test_other_formats_are_refused(data):
    with pytest.raises(BadRecordError):
        embedding_from_bytes(data)


def test_tensors_without_the_fields_are_refused():
    with pytest.raises(BadRecordError):
        embedding_from_bytes(save({"weights": np.zeros((2, 3), dtype=np.float32)}))


@pytest.mark.parametrize("missing", ["header", *ARRAYS, "eigenvalues_0", "coordinates_1"])
def test_a_record_without_one_of_its_arrays_is_refused(missing):
    arrays = load(embedding_to_bytes(embedding()))
    del arrays[missing]
    with pytest.raises(BadRecordError):
        embedding_from_bytes(save(arrays))


@pytest.mark.parametrize(
    "header",
    [
        b"",
        b"\xff\xfe",
        b"[]",
        b"null",
        b'"text"',
        b"{}",
        json.dumps({"fingerprint": "0" * 16, "facts": {}, "spectra": []}).encode(),
        json.dumps({"fingerprint": "0" * 16, "facts": {"colour": 1}, "spectra": []}).encode(),
        json.dumps({"fingerprint": "0" * 16, "facts": [], "spectra": []}).encode(),
    ],
)
def test_a_header_that_is_not_one_is_refused(header):
    arrays = load(embedding_to_bytes(embedding()))
    arrays["header"] = np.frombuffer(header, dtype=np.uint8)
    with pytest.raises(BadRecordError):
        embedding_from_bytes(save(arrays))
