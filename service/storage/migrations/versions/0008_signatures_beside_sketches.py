"""Signatures once more beside the sketches, so that a start reads them without touching the records."""

import sqlalchemy as sa
from alembic import op

from service.storage.columns import Float32Vector

revision = "0008"
down_revision = "0007"

AT_ONCE = 10_000


def upgrade() -> None:
    """Copy them; an embedding whose record could not be read now has a row too, with an empty sketch."""
    op.add_column("sketches", sa.Column("signature", sa.LargeBinary()))
    sketches = sa.table(
        "sketches",
        sa.column("embedding_number"),
        sa.column("data", sa.LargeBinary),
        sa.column("signature", sa.LargeBinary),
    )
    embeddings = sa.table("embeddings", sa.column("number"), sa.column("signature", Float32Vector))
    connection = op.get_bind()
    without = sa.select(embeddings.c.number, sa.literal(b"", sa.LargeBinary)).where(
        embeddings.c.number.not_in(sa.select(sketches.c.embedding_number))
    )
    connection.execute(sa.insert(sketches).from_select(["embedding_number", "data"], without))
    some = (
        sa.select(embeddings)
        .where(embeddings.c.number > sa.bindparam("last"))
        .order_by(embeddings.c.number)
        .limit(AT_ONCE)
    )
    copied = (
        sa.update(sketches)
        .where(sketches.c.embedding_number == sa.bindparam("number"))
        .values(signature=sa.bindparam("copy"))
    )
    last = 0
    while batch := connection.execute(some, {"last": last}).all():
        rows = [{"number": number, "copy": signature.astype("<f4").tobytes()} for number, signature in batch]
        connection.execute(copied, rows)
        last = batch[-1][0]
    with op.batch_alter_table("sketches") as table:
        table.alter_column("signature", existing_type=sa.LargeBinary(), nullable=False)
