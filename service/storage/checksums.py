"""Checksums of stored bytes and shapes: a flipped bit in the file changes one of them.

The checksum is BLAKE2b (RFC 7693) with 128 bits, in hexadecimal digits.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from hashlib import blake2b, sha256
from typing import Any

from core.errors import BadRecordError

LENGTH = 32
"""Hexadecimal digits of a checksum."""

SHAPE_COLUMNS = ("id", "collection_number", "blob_number", "format", "name", "folded_name", "meta", "facts")
SHAPE_TIMES = ("created_at", "updated_at", "deleted_at")
"""The columns that the checksum of a shape covers. Revisions change for all shapes at once."""


def checksum_of(data: bytes) -> str:
    """Return the checksum of some bytes."""
    return blake2b(data, digest_size=LENGTH // 2).hexdigest()


def is_whole(data: bytes, checksum: str) -> bool:
    """Return whether bytes have their checksum."""
    return checksum_of(data) == checksum


def whole_file(data: bytes, digest: str) -> bytes:
    """Return the bytes of a stored file.

    Raise BadRecordError if the bytes do not have the SHA-256 that is stored with them.
    """
    if sha256(data).hexdigest() != digest:
        raise BadRecordError(f"the stored file is damaged: it does not have the SHA-256 {digest}")
    return data


def shape_checksum(columns: Mapping[str, Any], tags: Sequence[str], values: Iterable[tuple[str, str]]) -> str:
    """Return the checksum of a shape: its columns, its tags in their order, and its metadata for filters.

    The columns are `SHAPE_COLUMNS` and `SHAPE_TIMES`, as the database gives them: JSON as objects or as text,
    times as such or as the text of SQLite. `values` has keys and values of the metadata.
    """
    content = {
        **{name: columns[name] for name in SHAPE_COLUMNS},
        **{name: _object(columns[name]) for name in ("meta", "facts")},
        **{name: _time(columns[name]) for name in SHAPE_TIMES},
        "tags": list(tags),
        "values": sorted(values),
    }
    return checksum_of(json.dumps(content, sort_keys=True).encode())


def pipeline_checksum(fingerprint: str, method: int, parameters: Mapping[str, Any] | str) -> str:
    """Return the checksum of a pipeline; its parameters are an object, or the text of it."""
    return checksum_of(json.dumps([fingerprint, method, _object(parameters)], sort_keys=True).encode())


def _object(value: Any) -> Any:  # noqa: ANN401
    return json.loads(value) if isinstance(value, str) else value


def _time(value: str | datetime | None) -> str | None:
    """Return a time as SQLite stores it: in UTC, without a zone."""
    return value.astimezone(UTC).strftime("%Y-%m-%d %H:%M:%S.%f") if isinstance(value, datetime) else value
