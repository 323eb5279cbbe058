"""Facets as JSON: numbers of shapes by the values of filters."""

from pydantic import BaseModel, Field


class Count(BaseModel):
    """The number of shapes in a list that is filtered by one value more."""

    value: str = Field(description="The value of the filter.")
    count: int


class LengthBand(Count):
    """The number of shapes whose length is above `least` and at most `greatest`."""

    least: float
    greatest: float


class Facets(BaseModel):
    """Numbers of shapes by the values of filters.

    Each count is the total of `GET /shapes` once its value is chosen: a tag joins the tags of the filter; a
    format, a length or a collection takes the place of the one before.
    """

    total: int = Field(description="All shapes that pass the filter.")
    tags: list[Count] = Field(description="The most frequent first, then by name.")
    distinct_tags: int = Field(description="The number of tags, with those beyond `limit`.")
    formats: list[Count] = Field(description="The most frequent first, then by name.")
    lengths: list[LengthBand] = Field(
        description="Lengths between 1, 2 and 5 times powers of ten, ascending, without empty bands."
    )
    collections: list[Count] = Field(description="All that the key may use, by name.")
