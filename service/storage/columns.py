"""Column types for 64-bit numbers, float32 vectors, times in UTC and text with any character.

SQLite stores a vector as bytes; PostgreSQL stores it as a `vector` of pgvector, which it can search.
"""

from datetime import UTC, datetime
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import BigInteger, ColumnElement, DateTime, Dialect, Integer, LargeBinary, String
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.functions import FunctionElement
from sqlalchemy.types import TypeDecorator, TypeEngine, UserDefinedType

POSTGRESQL = "postgresql"

Number = BigInteger().with_variant(Integer(), "sqlite")
"""A 64-bit integer. SQLite needs the type INTEGER to generate numbers."""


class PgVector(UserDefinedType[Any]):
    """The type `vector` of pgvector, of a fixed length or of any."""

    cache_ok = True

    def __init__(self, length: int | None = None) -> None:
        self.length = length

    def get_col_spec(self, **_: object) -> str:
        """Return the name of the type in SQL."""
        return "vector" if self.length is None else f"vector({self.length})"


class _AsBytes(FunctionElement[bytes]):
    """The bytes of a vector. PostgreSQL sends pgvector's binary format, which is faster than its text."""

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


class Vector(TypeDecorator[NDArray[Any]]):
    """A vector of float32 or of bytes, shape (s,), returned bit for bit as stored."""

    impl = LargeBinary
    cache_ok = True

    def __init__(self, item: Literal["<f4", "u1"]) -> None:
        super().__init__()
        self.item = item

    def load_dialect_impl(self, dialect: Dialect) -> TypeEngine[Any]:
        """Return the column type of the dialect."""
        return dialect.type_descriptor(PgVector() if dialect.name == POSTGRESQL else LargeBinary())

    def column_expression(self, column: ColumnElement[Any]) -> ColumnElement[Any]:
        """Return the expression that a query selects."""
        return _AsBytes(column, self)

    def process_bind_param(self, value: NDArray[Any] | None, dialect: Dialect) -> bytes | str | None:
        """Return the little-endian bytes of the vector, or its text."""
        if value is None:
            return None
        vector = np.ascontiguousarray(value, dtype=self.item)
        return vector_text(vector) if dialect.name == POSTGRESQL else vector.tobytes()

    def process_result_value(self, value: bytes | None, dialect: Dialect) -> NDArray[Any] | None:
        """Decode a vector; pgvector sends big-endian floats after its length and two empty bytes."""
        if value is None:
            return None
        if dialect.name == POSTGRESQL:
            return np.frombuffer(value, dtype=">f4", offset=4).astype(self.item)
        return np.frombuffer(value, dtype=self.item)


def vector_text(vector: NDArray[Any]) -> str:
    """Return the text of a vector for pgvector, exact to the last bit."""
    return f"[{','.join(map(str, vector.tolist()))}]"


class AnyText(TypeDecorator[str]):
    """Text with any character. PostgreSQL cannot store NUL, which is escaped with a backslash there."""

    impl = String
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """Escape backslashes and NULs on PostgreSQL."""
        if value is None or dialect.name != POSTGRESQL:
            return value
        return value.replace("\\", "\\\\").replace("\0", "\\0")

    def process_result_value(self, value: str | None, dialect: Dialect) -> str | None:
        """Restore escaped backslashes and NULs."""
        if value is None or dialect.name != POSTGRESQL:
            return value
        return "\\".join(part.replace("\\0", "\0") for part in value.split("\\\\"))


class UtcDateTime(TypeDecorator[datetime]):
    """A time in UTC. SQLite stores no time zone: it is removed on writing and added on reading."""

    impl = DateTime
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Convert a time to UTC and remove its time zone."""
        return None if value is None else value.astimezone(UTC).replace(tzinfo=None)

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Add the time zone UTC."""
        return None if value is None else value.replace(tzinfo=UTC)
