"""Collections. What is stored comes into the first, `default`."""

from datetime import UTC, datetime

import sqlalchemy as sa
from alembic import op

from service.storage.columns import POSTGRESQL, Number, UtcDateTime

revision = "0009"
down_revision = "0008"

COLUMN, DEFAULT = "collection_number", 1


def upgrade() -> None:
    """Make their table, and have shapes, deleted shapes, jobs and idempotency keys be of one."""
    collections = op.create_table(
        "collections",
        sa.Column("number", Number, nullable=False),
        sa.Column("name", sa.String(64), nullable=False),
        sa.Column("created_at", UtcDateTime(), nullable=False),
        sa.PrimaryKeyConstraint("number"),
        sa.UniqueConstraint("name"),
        sqlite_autoincrement=True,
    )
    # By the counter, so that it does not give the number again.
    op.execute(sa.insert(collections).values(name="default", created_at=datetime.now(UTC)))
    _extend("shapes", unique=("one_shape_a_name", ("blob_number", "format", "name")))
    _extend("deleted_shapes")
    _extend("jobs")
    _extend("idempotency_keys", ondelete="CASCADE", key=("idempotency_keys_pkey", ("scope", "key")))
    op.drop_index("shapes_by_folded_name", "shapes")
    op.create_index("shapes_by_folded_name", "shapes", [COLUMN, "folded_name"])
    op.create_index("shapes_by_collection", "shapes", [COLUMN, "number"])
    op.create_index("deleted_shapes_by_collection", "deleted_shapes", [COLUMN, "number"])
    op.create_index("jobs_by_collection", "jobs", [COLUMN, "number"])


Columns = tuple[str, tuple[str, ...]]


def _extend(
    name: str, *, ondelete: str | None = None, unique: Columns | None = None, key: Columns | None = None
) -> None:
    """Give a table the column, also in the unique constraint or primary key of these columns."""
    if op.get_bind().dialect.name == POSTGRESQL:
        _extend_in_place(name, ondelete, unique, key)
    else:
        _make_anew(name, ondelete, unique, key)


def _extend_in_place(name: str, ondelete: str | None, unique: Columns | None, key: Columns | None) -> None:
    op.add_column(name, sa.Column(COLUMN, Number, nullable=False, server_default=str(DEFAULT)))
    op.alter_column(name, COLUMN, server_default=None)
    op.create_foreign_key(None, name, "collections", [COLUMN], ["number"], ondelete=ondelete)
    if unique is not None:
        op.drop_constraint(unique[0], name, type_="unique")
        op.create_unique_constraint(unique[0], name, [*unique[1], COLUMN])
    if key is not None:
        op.drop_constraint(key[0], name, type_="primary")
        op.create_primary_key(key[0], name, [COLUMN, *key[1]])


def _make_anew(name: str, ondelete: str | None, unique: Columns | None, key: Columns | None) -> None:
    """As SQLite changes a table: another of the same columns, with all rows, in its place."""
    connection = op.get_bind()
    old = sa.Table(name, sa.MetaData(), autoload_with=connection)
    counted = connection.execute(
        sa.text("SELECT seq FROM sqlite_sequence WHERE name = :name"), {"name": name}
    )
    last = counted.scalar_one_or_none()
    constraints: list[sa.Constraint] = [
        sa.ForeignKeyConstraint([COLUMN], ["collections.number"], ondelete=ondelete),
        sa.PrimaryKeyConstraint(*([COLUMN, *key[1]] if key else [c.name for c in old.primary_key])),
    ]
    constraints += [
        sa.ForeignKeyConstraint(each.column_keys, [element.target_fullname for element in each.elements])
        for each in sorted(old.foreign_key_constraints, key=lambda each: list(each.column_keys))
    ]
    others = [each for each in old.constraints if isinstance(each, sa.UniqueConstraint)]
    constraints += [
        sa.UniqueConstraint(*each.columns.keys(), name=each.name)
        for each in sorted(others, key=lambda each: each.columns.keys())
        if unique is None or each.name != unique[0]
    ]
    if unique is not None:
        constraints.append(sa.UniqueConstraint(*unique[1], COLUMN, name=unique[0]))
    anew = op.create_table(
        f"{name}_anew",
        *(sa.Column(c.name, c.type, nullable=c.nullable) for c in old.columns),
        sa.Column(COLUMN, Number, nullable=False, autoincrement=False),
        *constraints,
        sqlite_autoincrement=key is None,
    )
    rows = sa.select(*old.columns, sa.literal(DEFAULT))
    connection.execute(sa.insert(anew).from_select([*old.columns.keys(), COLUMN], rows))
    indexes = [(index.name, [c.name for c in index.columns]) for index in old.indexes]
    op.drop_table(name)
    op.rename_table(f"{name}_anew", name)
    for index, columns in indexes:
        op.create_index(index, name, columns)
    if last is not None:
        # Rows that were deleted had later numbers, which must not be given again.
        connection.execute(sa.text("DELETE FROM sqlite_sequence WHERE name = :name"), {"name": name})
        connection.execute(
            sa.text("INSERT INTO sqlite_sequence (name, seq) VALUES (:name, :last)"),
            {"name": name, "last": last},
        )
