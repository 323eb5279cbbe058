"""An archive of any size, filled with noisy copies of real embeddings, for benchmarks."""

import hashlib
import uuid
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
from sqlalchemy import insert, update

from core.arrays import Float32s
from core.descriptors.facts import intrinsic_reliability
from core.descriptors.partial import is_part
from core.descriptors.views import view_signature
from core.embedding import Embedding, Spectrum
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.reranking import coarse_samples, quantised_points
from core.serialization import embedding_to_bytes
from service.collection import DEFAULT_COLLECTION
from service.evaluation.benchmark_meshes import Source
from service.pipelines.active import Pipelines, begin
from service.storage.checksums import checksum_of
from service.storage.database import Database
from service.storage.migrate import migrate
from service.storage.tables import (
    ArchiveRow,
    BlobRow,
    CoarseSamplesRow,
    EmbeddingRow,
    QuantisedPointsRow,
    ShapeRow,
)

NOISE = 0.2
"""The largest noise of coordinates relative to their root mean square; that of signatures is a quarter."""

AT_ONCE = 2_000
"""Shapes written in one transaction."""

BOX = [1.0, 1.0, 1.0]
"""The bounding box of all shapes."""

STEP = 7919
"""The step between the numbers of shapes that are mixed or queried, coprime to all sizes."""

TABLES = (BlobRow, ShapeRow, EmbeddingRow, CoarseSamplesRow, QuantisedPointsRow)


@dataclass(frozen=True, eq=False)
class Original:
    """A shape of the source and its embedding."""

    label: str
    name: str
    embedding: Embedding


def originals(source: Source) -> list[Original]:
    """Return all meshes of the source with embeddings by the default parameters."""
    method = Pipeline(DEFAULT)
    return [
        Original(label, name, method.embed(mesh))
        for label, meshes in source.classes.items()
        for name, mesh in meshes
    ]


def shaken(embedding: Embedding, number: int, other: Embedding | None = None) -> Embedding:
    """Return the embedding with noise; the number seeds the noise and its strength.

    The views, and the spin images of a complete surface, are mixed with those of another shape, by twice the
    strength.
    """
    rng = np.random.default_rng(number)
    strength = NOISE * rng.random()
    spectra = tuple(
        Spectrum(spectrum.name, spectrum.eigenvalues, _shaken(spectrum.coordinates, strength, rng))
        for spectrum in embedding.spectra
    )
    signature = _shaken(embedding.signature, 0.25 * strength, rng)
    shaken = replace(embedding, spectra=spectra, signature=signature)
    if other is None:
        return shaken
    views = (1.0 - 2.0 * strength) * embedding.descriptors["views"] + 2.0 * strength * other.descriptors[
        "views"
    ]
    spin_images = embedding.descriptors["spin_images"].copy()
    if not is_part(spin_images):
        rows = rng.random(len(spin_images)) < 2.0 * strength
        spin_images[rows] = other.descriptors["spin_images"][: len(spin_images)][rows]
    return replace(shaken, descriptors={"spin_images": spin_images, "views": np.rint(views).astype(np.uint8)})


def _shaken(values: Float32s, strength: float, rng: np.random.Generator) -> Float32s:
    scale = strength * np.sqrt((values**2).mean(axis=0, keepdims=True))
    noise = rng.standard_normal(values.shape, dtype=np.float32)
    return np.asarray(values + scale * noise, dtype=np.float32)


def fill(url: str, source: Sequence[Original], count: int) -> None:
    """Fill an archive with `count` shapes: the originals, then noisy copies of them in turn.

    A file of a few bytes replaces each mesh.
    """
    database = Database(url, lock_seconds=60.0)
    migrate(database)
    begin(Pipelines(DEFAULT), database)
    for start in range(0, count, AT_ONCE):
        numbers = range(start, min(start + AT_ONCE, count))
        with database.write() as session:
            for table, rows in zip(TABLES, zip(*_rows(source, numbers), strict=True), strict=True):
                session.execute(insert(table), list(rows))
            session.execute(update(ArchiveRow).values(revision=numbers[-1] + 1))
    database.close()


def _rows(source: Sequence[Original], numbers: range) -> Iterator[tuple[dict[str, Any], ...]]:
    """Yield the rows of each shape, one for each of `TABLES`."""
    now = datetime.now(UTC)
    for number in numbers:
        original = source[number % len(source)]
        embedding = original.embedding
        if number >= len(source):
            mixed = source[number // len(source) * STEP % len(source)]
            embedding = shaken(embedding, number, mixed.embedding)
        data = number.to_bytes(8, "big")
        name = f"{original.label}|{original.name}|{number}"
        record, points = embedding_to_bytes(embedding), quantised_points(embedding)
        coarse = coarse_samples(embedding).tobytes()
        yield (
            {"number": number + 1, "sha256": hashlib.sha256(data).hexdigest(), "size": 8, "data": data},
            {
                "number": number + 1,
                "id": shape_id(number),
                "collection_number": DEFAULT_COLLECTION.number,
                "blob_number": number + 1,
                "format": "off",
                "name": name,
                "folded_name": name.casefold(),
                "meta": {},
                "facts": {**asdict(embedding.facts), "bounding_box": BOX},
                "created_at": now,
                "updated_at": now,
                "revision": number + 1,
                "checksum": "",
            },
            {
                "number": number + 1,
                "blob_number": number + 1,
                "format": "off",
                "fingerprint": DEFAULT.fingerprint,
                "signature": embedding.signature,
                "record": record,
                "checksum": checksum_of(record),
            },
            {
                "embedding_number": number + 1,
                "data": coarse,
                "signature": embedding.signature.astype("<f4").tobytes(),
                "view_signature": view_signature(embedding.descriptors["views"]),
                "reliability": intrinsic_reliability(embedding.facts),
                "checksum": checksum_of(coarse),
            },
            {"embedding_number": number + 1, "data": points, "checksum": checksum_of(points)},
        )


def label_of(name: str) -> str:
    """Return the class in the name of a shape of such an archive."""
    return name.split("|", maxsplit=1)[0]


def shape_id(number: int) -> str:
    """Return the id of the shape with a number, counted from 0."""
    return str(uuid.UUID(int=number + 1))
