"""An archive of any size, filled with noisy copies of real embeddings."""

import hashlib
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from core.arrays import Float32s
from core.embedding import Embedding, Spectrum
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.ranking.coarse_ranking import coarse_samples
from core.serialization import embedding_to_bytes
from service.collection import DEFAULT_COLLECTION
from service.pipelines.active import Pipelines
from service.pipelines.starting import begin
from service.storage.database import Database
from service.storage.migrate import migrate
from service.studies.benchmark import repository
from service.studies.benchmark.meshes import Source

NOISE = 0.2
"""The largest noise of coordinates relative to their root mean square; that of signatures is a quarter."""

AT_ONCE = 2_000


@dataclass(frozen=True, eq=False)
class Original:
    """A shape of the source and its embedding."""

    label: str
    name: str
    embedding: Embedding


def originals(source: Source) -> list[Original]:
    """All meshes of the source with embeddings by the default parameters."""
    method = Pipeline(DEFAULT)
    return [
        Original(label, name, method.embed(mesh))
        for label, meshes in source.classes.items()
        for name, mesh in meshes
    ]


def shaken(embedding: Embedding, number: int) -> Embedding:
    """The embedding with noise; the number seeds the noise and its strength."""
    rng = np.random.default_rng(number)
    strength = NOISE * rng.random()
    spectra = tuple(
        Spectrum(one.name, one.eigenvalues, _shaken(one.coordinates, strength, rng))
        for one in embedding.spectra
    )
    return replace(embedding, spectra=spectra, signature=_shaken(embedding.signature, 0.25 * strength, rng))


def _shaken(values: Float32s, strength: float, rng: np.random.Generator) -> Float32s:
    scale = strength * np.sqrt((values**2).mean(axis=0, keepdims=True))
    noise = rng.standard_normal(values.shape, dtype=np.float32)
    return np.asarray(values + scale * noise, dtype=np.float32)


def fill(url: str, source: Sequence[Original], count: int, told: Callable[[int], object]) -> None:
    """Fill an archive with `count` shapes: the originals, then noisy copies of them in turn.

    A file of a few bytes replaces each mesh. `told` is called with the number of written shapes.
    """
    database = Database(url, lock_seconds=60.0)
    migrate(database)
    begin(Pipelines(DEFAULT), database)
    for start in range(0, count, AT_ONCE):
        numbers = range(start, min(start + AT_ONCE, count))
        rows = [list(kind) for kind in zip(*_rows(source, numbers), strict=True)]
        with database.write() as session:
            repository.add(session, rows, numbers[-1] + 1)
        told(len(numbers))
    database.close()


def _rows(source: Sequence[Original], numbers: range) -> Iterator[tuple[dict[str, Any], ...]]:
    now = datetime.now(UTC)
    for number in numbers:
        original = source[number % len(source)]
        copy = number >= len(source)
        embedding = shaken(original.embedding, number) if copy else original.embedding
        data = number.to_bytes(8, "big")
        name = f"{original.label}|{original.name}|{number}"
        facts = {field: getattr(embedding.facts, field) for field in embedding.facts.__dataclass_fields__}
        yield (
            {"number": number + 1, "sha256": hashlib.sha256(data).hexdigest(), "size": 8, "data": data},
            {
                "number": number + 1,
                "id": str(uuid.UUID(int=number + 1)),
                "collection_number": DEFAULT_COLLECTION.number,
                "blob_number": number + 1,
                "format": "off",
                "name": name,
                "folded_name": name.casefold(),
                "meta": {},
                "facts": facts,
                "created_at": now,
                "updated_at": now,
                "revision": number + 1,
            },
            {
                "number": number + 1,
                "blob_number": number + 1,
                "format": "off",
                "fingerprint": DEFAULT.fingerprint,
                "signature": embedding.signature,
                "record": embedding_to_bytes(embedding),
            },
            {
                "embedding_number": number + 1,
                "data": coarse_samples(embedding).tobytes(),
                "signature": embedding.signature.astype("<f4").tobytes(),
            },
        )


def label_of(name: str) -> str:
    """The class in the name of a shape of such an archive."""
    return name.split("|", maxsplit=1)[0]


def shape_id(number: int) -> str:
    """The id of the shape with a number, counted from 0."""
    return str(uuid.UUID(int=number + 1))
