"""Column types: numbers, vectors, times with their zone, and text of any characters.

On SQLite a vector is its bytes; on PostgreSQL it is a `vector` of pgvector, which can be searched there.
"""

from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import BigInteger, ColumnElement, DateTime, Dialect, Integer, LargeBinary, String
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.functions import FunctionElement
from sqlalchemy.types import TypeDecorator, TypeEngine, UserDefinedType

POSTGRESQL = "postgresql"

Number = BigInteger().with_variant(Integer(), "sqlite")
"""A whole number of 64 bits; SQLite calls every whole number an integer, and counts up no other."""


class PgVector(UserDefinedType[Any]):
    """The type `vector` of pgvector, of a length or of any."""

    cache_ok = True

    def __init__(self, length: int | None = None) -> None:
        self.length = length

    def get_col_spec(self, **_: object) -> str:
        """Its name in SQL."""
        return "vector" if self.length is None else f"vector({self.length})"


class _AsBytes(FunctionElement[bytes]):
    """A vector as its bytes: by pgvector's own binary form on PostgreSQL, whose text takes long to read."""

    inherit_cache = True

    def __init__(self, column: ColumnElement[Any], vector: TypeEngine[Any]) -> None:
        super().__init__(column)
        self.type = vector


@compiles(_AsBytes)
def _stored_as_bytes(element: _AsBytes, compiler: Any, **options: object) -> str:  # noqa: ANN401
    return str(compiler.process(element.clauses, **options))


@compiles(_AsBytes, POSTGRESQL)
def _sent_as_bytes(element: _AsBytes, compiler: Any, **options: object) -> str:  # noqa: ANN401
    return f"vector_send({compiler.process(element.clauses, **options)})"


class Float32Vector(TypeDecorator[NDArray[np.float32]]):
    """A vector of float32, shape (s,): bit for bit what was stored."""

    impl = LargeBinary
    cache_ok = True

    def load_dialect_impl(self, dialect: Dialect) -> TypeEngine[Any]:
        """The type of the column."""
        return dialect.type_descriptor(PgVector() if dialect.name == POSTGRESQL else LargeBinary())

    def column_expression(self, column: ColumnElement[Any]) -> ColumnElement[Any]:
        """What is selected."""
        return _AsBytes(column, self)

    def process_bind_param(self, value: NDArray[np.float32] | None, dialect: Dialect) -> bytes | str | None:
        """The vector's little-endian bytes, or its text."""
        if value is None:
            return None
        vector = np.ascontiguousarray(value, dtype="<f4")
        return vector_text(vector) if dialect.name == POSTGRESQL else vector.tobytes()

    def process_result_value(self, value: bytes | None, dialect: Dialect) -> NDArray[np.float32] | None:
        """The vector; pgvector sends its length and two empty bytes before it, and the largest byte first."""
        if value is None:
            return None
        if dialect.name == POSTGRESQL:
            return np.frombuffer(value, dtype=">f4", offset=4).astype("<f4")
        return np.frombuffer(value, dtype="<f4")


def vector_text(vector: NDArray[np.float32]) -> str:
    """A vector of float32 as pgvector reads it: to the last bit."""
    return f"[{','.join(map(str, vector.tolist()))}]"


class AnyText(TypeDecorator[str]):
    """Text that is looked up as it came: PostgreSQL keeps no NUL, so that one is written otherwise there."""

    impl = String
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """The text, in which a backslash escapes on PostgreSQL."""
        if value is None or dialect.name != POSTGRESQL:
            return value
        return value.replace("\\", "\\\\").replace("\0", "\\0")

    def process_result_value(self, value: str | None, dialect: Dialect) -> str | None:
        """The text as it came."""
        if value is None or dialect.name != POSTGRESQL:
            return value
        return "\\".join(part.replace("\\0", "\0") for part in value.split("\\\\"))


class UtcDateTime(TypeDecorator[datetime]):
    """A time in UTC. SQLite keeps no zone, so it is taken off on the way in and put back on the way out."""

    impl = DateTime
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """The time in UTC, without its zone."""
        return None if value is None else value.astimezone(UTC).replace(tzinfo=None)

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """The time with its zone."""
        return None if value is None else value.replace(tzinfo=UTC)
