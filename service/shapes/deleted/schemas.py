"""JSON models of deleted shapes."""

from datetime import datetime, timedelta

from pydantic import BaseModel, Field, JsonValue

from service.shapes.deleted.records import DeletedPage, DeletedRecord
from service.shapes.pages import write_cursor


class DeletedShape(BaseModel):
    """A deleted shape that can be restored."""

    id: str
    name: str
    tags: list[str]
    metadata: dict[str, JsonValue]
    format: str = Field(description="The format in which the file was read.")
    bytes: int = Field(description="Size of the file.")
    sha256: str = Field(description="SHA-256 of the file.")
    created_at: datetime = Field(description="UTC.")
    deleted_at: datetime = Field(description="UTC.")
    gone_at: datetime = Field(description="The time until which the shape can be restored. UTC.")

    @classmethod
    def of(cls, record: DeletedRecord, keep: timedelta) -> "DeletedShape":
        """The JSON of a record."""
        return cls(
            id=record.id,
            name=record.name,
            tags=list(record.tags),
            metadata=dict(record.metadata),
            format=record.format,
            bytes=record.size,
            sha256=record.sha256,
            created_at=record.created_at,
            deleted_at=record.deleted_at,
            gone_at=record.deleted_at + keep,
        )


class DeletedShapePage(BaseModel):
    """A page of deleted shapes, in the order of their deletion."""

    shapes: list[DeletedShape]
    total: int = Field(description="The number of shapes that can be restored.")
    undo_days: float = Field(description="How many days after its deletion a shape can be restored.")
    next_cursor: str | None = Field(description="The `cursor` of the next page; null on the last page.")

    @classmethod
    def of(cls, page: DeletedPage, keep: timedelta) -> "DeletedShapePage":
        """The JSON of a page."""
        return cls(
            shapes=[DeletedShape.of(record, keep) for record in page.shapes],
            total=page.total,
            undo_days=keep / timedelta(days=1),
            next_cursor=None if page.after is None else write_cursor(page.after),
        )
