"""Maps as JSON."""

from typing import TYPE_CHECKING

from pydantic import BaseModel, Field

if TYPE_CHECKING:
    from core.ranking.similarity_map import SimilarityMap


class MapShape(BaseModel):
    """A shape of a map."""

    id: str
    name: str
    x: float = Field(description="Position from left to right, in [0, 1].")
    y: float = Field(description="Position from top to bottom, in [0, 1].")
    column: int = Field(description="Column of the shape's cell, from 0.")
    row: int = Field(description="Row of the shape's cell, from 0.")


class MapAnswer(BaseModel):
    """Shapes on a plane; similar shapes are near each other."""

    shapes: list[MapShape] = Field(description="The oldest first; no two have one cell.")
    size: int = Field(description="The number of columns, and of rows.")
    total: int = Field(
        description="The number of shapes that pass the filter. The map has at most "
        "2,000 of them, chosen evenly by age."
    )

    @classmethod
    def of(cls, ids: list[str], names: list[str], laid_out: "SimilarityMap", total: int) -> "MapAnswer":
        """Write the JSON of a map."""
        rows = zip(ids, names, laid_out.positions.tolist(), laid_out.cells.tolist(), strict=True)
        return cls(
            shapes=[
                MapShape(id=id, name=name, x=x, y=y, column=column, row=row)
                for id, name, (x, y), (column, row) in rows
            ],
            size=laid_out.size,
            total=total,
        )
