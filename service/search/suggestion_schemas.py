"""Suggested tags and metadata as JSON."""

from pydantic import BaseModel, ConfigDict, Field, JsonValue

from service.shapes.schemas import SHAPE

LEAST_SHARE = 0.5
"""Share of the neighbours, by weight, from which a value is suggested unless the request names another."""


class SuggestingShape(BaseModel):
    """A neighbour that has a suggested value."""

    id: str
    name: str


class Suggestion(BaseModel):
    """A tag, or an entry of the metadata, of neighbours."""

    key: str | None = Field(default=None, description="The key of the metadata; null for a tag.")
    value: JsonValue = Field(description="The tag, or the value of the metadata.")
    share: float = Field(description="The share of the neighbours that have it, by their weights, in [0, 1].")
    shapes: list[SuggestingShape] = Field(description="These neighbours, the likeliest first.")


class Suggestions(BaseModel):
    """Tags and metadata that the neighbours of a shape suggest for it."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "suggestions": [
                    {"value": "horse", "share": 0.94, "shapes": [{"id": SHAPE["id"], "name": "foal.off"}]}
                ],
                "known": True,
            }
        }
    )

    suggestions: list[Suggestion] = Field(description="The greatest share first.")
    known: bool = Field(
        description="Whether the neighbours of the shape are known. They are found in the background."
    )
