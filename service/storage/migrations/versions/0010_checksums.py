"""Checksums of embeddings, sketches, thumbnails, pieces of archives, shapes and pipelines.

The code that computes them is frozen here: a later version of the service may compute other ones.
"""

import json
from collections.abc import Iterator
from hashlib import blake2b
from itertools import groupby
from typing import Any

import sqlalchemy as sa
from alembic import op

from service.storage.columns import AnyText, UtcDateTime

revision = "0010"
down_revision = "0009"

AT_ONCE = 100
# The primary key of each table, and the column with the bytes.
BYTES = {
    "embeddings": (("number",), "record"),
    "sketches": (("embedding_number",), "data"),
    "thumbnails": (("blob_number", "format", "size"), "data"),
    "job_pieces": (("job_number", "place"), "data"),
}
SHAPE: dict[str, Any] = {
    "id": AnyText(36),
    "collection_number": sa.Integer(),
    "blob_number": sa.Integer(),
    "format": sa.String(8),
    "name": sa.String(255),
    "folded_name": sa.String(1024),
    "meta": sa.JSON(),
    "facts": sa.JSON(),
    "created_at": UtcDateTime(),
    "updated_at": UtcDateTime(),
}


def upgrade() -> None:
    """Compute the checksums of all that is stored, in batches."""
    for table in (*BYTES, "shapes", "pipelines"):
        op.add_column(table, sa.Column("checksum", sa.String(32)))
    for name, (key, column) in BYTES.items():
        _seal_bytes(name, key, column)
    _seal_shapes()
    _seal_pipelines()


def _seal_bytes(name: str, key: tuple[str, ...], column: str) -> None:
    connection = op.get_bind()
    table = sa.table(
        name, *(sa.column(each) for each in (*key, "checksum")), sa.column(column, sa.LargeBinary)
    )
    keys = [table.c[each] for each in key]
    found = connection.execute(sa.select(*keys).order_by(*keys)).all()
    change = (
        sa.update(table)
        .where(*(table.c[each] == sa.bindparam(f"key_{each}") for each in key))
        .values(checksum=sa.bindparam("sum"))
    )
    for start in range(0, len(found), AT_ONCE):
        rows = []
        for row in found[start : start + AT_ONCE]:
            same = [table.c[each] == value for each, value in zip(key, row, strict=True)]
            data = connection.execute(sa.select(table.c[column]).where(*same)).scalar_one()
            named = {f"key_{each}": value for each, value in zip(key, row, strict=True)}
            # A damaged file may have text in the place of bytes.
            rows.append({**named, "sum": _sum(data if isinstance(data, bytes) else str(data).encode())})
        connection.execute(change, rows)


def _seal_shapes() -> None:
    connection = op.get_bind()
    shapes = sa.table(
        "shapes",
        sa.column("number"),
        sa.column("checksum"),
        *(sa.column(name, kind) for name, kind in SHAPE.items()),
    )
    tags = sa.table("shape_tags", sa.column("shape_number"), sa.column("tag"), sa.column("place"))
    values = sa.table(
        "shape_metadata", sa.column("shape_number"), sa.column("key", AnyText), sa.column("value", AnyText)
    )
    change = (
        sa.update(shapes).where(shapes.c.number == sa.bindparam("shape")).values(checksum=sa.bindparam("sum"))
    )
    last = 0
    some = (
        sa.select(shapes)
        .where(shapes.c.number > sa.bindparam("last"))
        .order_by(shapes.c.number)
        .limit(AT_ONCE)
    )
    while batch := connection.execute(some, {"last": last}).all():
        first, last = batch[0].number, batch[-1].number
        own_tags, own_values = (each.c.shape_number for each in (tags, values))
        tags_of = dict(
            _grouped(
                connection,
                sa.select(own_tags, tags.c.tag)
                .where(own_tags.between(first, last))
                .order_by(own_tags, tags.c.place),
            )
        )
        values_of = dict(
            _grouped(
                connection,
                sa.select(own_values, values.c.key, values.c.value)
                .where(own_values.between(first, last))
                .order_by(own_values),
            )
        )
        connection.execute(
            change,
            [
                {
                    "shape": row.number,
                    "sum": _shape_sum(
                        row,
                        [tag for (tag,) in tags_of.get(row.number, [])],
                        sorted(values_of.get(row.number, [])),
                    ),
                }
                for row in batch
            ],
        )


def _seal_pipelines() -> None:
    connection = op.get_bind()
    table = sa.table(
        "pipelines",
        sa.column("fingerprint"),
        sa.column("method"),
        sa.column("parameters", sa.JSON()),
        sa.column("checksum"),
    )
    columns = table.c.fingerprint, table.c.method, table.c.parameters
    for row in connection.execute(sa.select(*columns)).all():
        own = _sum(json.dumps(list(row), sort_keys=True).encode())
        connection.execute(
            sa.update(table).where(table.c.fingerprint == row.fingerprint).values(checksum=own)
        )


def _grouped(connection: sa.Connection, query: sa.Select[Any]) -> Iterator[tuple[int, list[tuple[Any, ...]]]]:
    """The rows of a query by their first column, a shape."""
    for number, group in groupby(connection.execute(query), key=lambda row: row[0]):
        yield number, [tuple(row)[1:] for row in group]


def _shape_sum(row: Any, tags: list[str], values: list[tuple[Any, ...]]) -> str:  # noqa: ANN401
    content = {name: getattr(row, name) for name in SHAPE}
    for name in ("created_at", "updated_at"):
        content[name] = content[name].strftime("%Y-%m-%d %H:%M:%S.%f")
    content |= {"tags": tags, "values": values}
    return _sum(json.dumps(content, sort_keys=True).encode())


def _sum(data: bytes) -> str:
    return blake2b(data, digest_size=16).hexdigest()
