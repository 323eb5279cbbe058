"""Landmarks of two shapes, and what is transferred from one to the other, as JSON."""

from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, FiniteFloat, Json, WithJsonSchema

LANDMARKS, POINTS, CURVES, CURVE_POINTS, VALUES = 64, 1000, 64, 1000, 200_000
"""The most landmarks, points, curves, points of a curve, and values at vertices."""

FARTHEST = 1e100
"""The largest coordinate: its square is a number."""

Coordinate = Annotated[FiniteFloat, Field(ge=-FARTHEST, le=FARTHEST)]
Position = Annotated[
    list[Coordinate],
    Field(
        description="Coordinates in the frame of the file and the unit of the shape.",
        min_length=3,
        max_length=3,
    ),
]


class Landmark(BaseModel):
    """Two points that correspond; each is taken to the nearest place of its surface."""

    model_config = ConfigDict(extra="forbid")

    first: Position
    second: Position


class Transfer(BaseModel):
    """Points, curves and values to transfer from the first shape to the second."""

    model_config = ConfigDict(extra="forbid")

    points: list[Position] = Field(
        default_factory=list, max_length=POINTS, description="Points on or near the first surface."
    )
    curves: list[Annotated[list[Position], Field(min_length=2, max_length=CURVE_POINTS)]] = Field(
        default_factory=list, max_length=CURVES, description="Polylines on or near the first surface."
    )
    values: list[FiniteFloat] | None = Field(
        default=None,
        min_length=1,
        max_length=VALUES,
        description="A number for each vertex of the first file.",
    )


Landmarks = Annotated[
    list[Landmark],
    Field(
        min_length=1,
        max_length=LANDMARKS,
        description="Points of both shapes that must correspond: the dense correspondence is chosen "
        "and fitted by them. Three or more tell apart the maps of a symmetric shape.",
    ),
]
TRANSFER = "Points, curves and values to transfer from the first shape to the second; needs format=json."


def _or_none(text: object) -> object:
    return text or "null"


FormLandmarks = Annotated[
    Json[Landmarks | None],
    BeforeValidator(_or_none),
    WithJsonSchema({"type": "string", "contentMediaType": "application/json"}),
]
FormTransfer = Annotated[
    Json[Transfer | None],
    BeforeValidator(_or_none),
    WithJsonSchema({"type": "string", "contentMediaType": "application/json"}),
]


class TransferredPoint(BaseModel):
    """The place of a point on the second shape."""

    position: list[float] = Field(
        description="Coordinates in the frame of the second file and the unit of the shape."
    )
    confidence: float = Field(description="As of the vertices of a dense correspondence, in [0, 1].")


class TransferredCurve(BaseModel):
    """A curve on both shapes, with points between those that were given."""

    first: list[list[float]]
    second: list[list[float]]
    first_length: float
    second_length: float


class Distances(BaseModel):
    """Distances between all points on one shape, in its unit."""

    straight: list[list[float]]
    along: list[list[float]] = Field(
        description="On the surface, along edges and across pairs of triangles: a few per cent longer than "
        "the shortest path."
    )


class TransferAnswer(BaseModel):
    """Transferred points, curves and values on the second shape, and distances on both."""

    points: list[TransferredPoint]
    curves: list[TransferredCurve]
    values: list[float | None] | None = Field(
        default=None,
        description="A number for each vertex of the second file: that of the corresponding vertex, null "
        "without a partner.",
    )
    first_distances: Distances | None = Field(
        default=None, description="Of 2 to 64 points: as they were given, on the first shape."
    )
    second_distances: Distances | None = Field(
        default=None, description="The same of the transferred points, on the second shape."
    )
    landmark_gaps: list[float] = Field(
        description="The distance of each landmark's image from its point on the second shape, in its unit."
    )
