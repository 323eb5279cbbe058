"""JSON models of collections."""

from datetime import datetime
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

COLLECTION: dict[str, Any] = {"name": "castings", "shapes": 190, "created_at": "2026-01-31T12:00:00Z"}


class Collection(BaseModel):
    """A named set of shapes."""

    model_config = ConfigDict(from_attributes=True, json_schema_extra={"example": COLLECTION})

    name: str = Field(description="The name by which requests choose the collection.")
    shapes: int = Field(description="The number of its shapes.")
    created_at: datetime = Field(description="UTC.")


class Collections(BaseModel):
    """The collections that the key may use, sorted by name."""

    model_config = ConfigDict(json_schema_extra={"example": {"collections": [COLLECTION]}})

    collections: list[Collection]
