"""JSON models of assemblies that are split into parts."""

from typing import Any

from pydantic import ConfigDict, Field

from service.shapes.records import StoredAssembly, StoredShape
from service.shapes.schemas import SHAPE, Shape

PART: dict[str, Any] = {
    **SHAPE,
    "id": "5f0d8a5e-7a0c-4c5b-9a53-0c2f4bb0a7de",
    "name": "gearbox.step/bolt",
    "format": "3mf",
    "metadata": {"assembly": "gearbox.step", "assembly_path": "gearbox/housing:1/bolt:1", "instances": 12},
    "created": True,
}


class SplitShape(Shape):
    """A shape of an assembly that was uploaded with split=parts."""

    model_config = ConfigDict(json_schema_extra={"example": PART})

    created: bool = Field(description="Whether the upload stored the shape; false if it was there before.")

    @classmethod
    def of_one(cls, stored: StoredShape) -> "SplitShape":
        """The JSON of a shape after the upload."""
        return cls(**Shape.of(stored.shape).model_dump(), created=stored.created)


class Assembly(SplitShape):
    """The shape of a whole assembly, and those of its parts."""

    model_config = ConfigDict(
        json_schema_extra={"example": {**SHAPE, "name": "gearbox.step", "created": True, "parts": [PART]}}
    )

    parts: list[SplitShape] = Field(
        description="The shapes of the distinct parts in the order of the file; empty for a file of one part."
    )

    @classmethod
    def of_stored(cls, stored: StoredAssembly) -> "Assembly":
        """The JSON of an assembly after the upload."""
        parts = [SplitShape.of_one(one) for one in stored.parts]
        return cls(**SplitShape.of_one(stored.whole).model_dump(), parts=parts)
