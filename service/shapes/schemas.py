"""Shapes as JSON."""

from datetime import datetime
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict, Field, JsonValue

from core.descriptors.completeness import INCOMPLETE
from service.shapes.fields import Metadata, Name, Tags
from service.shapes.pages import write_cursor
from service.shapes.records import Changes, RecordPage, ShapeRecord

if TYPE_CHECKING:
    from core.embedding import Embedding, Spectrum

SHAPE: dict[str, Any] = {
    "id": "0b7c1f4e-5a52-4c0e-9f0e-8d1a3f5f6a11",
    "name": "horse-gallop.off",
    "tags": ["horse", "animal"],
    "metadata": {"source": "scan", "year": 2024},
    "format": "off",
    "bytes": 231882,
    "sha256": "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08",
    "facts": {
        "vertices": 2892,
        "faces": 5780,
        "area": 1.732,
        "volume": 0.091,
        "scale": 0.402,
        "components": 1,
        "merged_vertices": 0,
        "dropped_faces": 0,
        "boundary_edges": 0,
        "nonmanifold_edges": 0,
        "openness": 0.0,
    },
    "warnings": [],
    "embedded": True,
    "created_at": "2026-01-31T12:00:00Z",
    "updated_at": "2026-01-31T12:00:00Z",
}


def warnings_of(openness: float) -> list[str]:
    """What to know of a surface when it is compared."""
    if openness <= INCOMPLETE:
        return []
    return [
        "the surface looks incomplete: its open rims would bound "
        f"{100 * openness:.0f} % of its area. A query finds what it is a part of with rank_by=combined or "
        "partial=true"
    ]


class MeshFacts(BaseModel):
    """What was measured on the mesh, in the units of the file."""

    vertices: int = Field(description="Vertices in the file.")
    faces: int = Field(description="Faces in the file.")
    area: float = Field(description="Surface area.")
    volume: float = Field(description="Volume; of little meaning when the mesh is not closed.")
    scale: float = Field(description="Root mean square distance of the surface from its centroid.")
    components: int = Field(description="Connected parts.")
    merged_vertices: int = Field(description="Vertices that coincided with another.")
    dropped_faces: int = Field(description="Faces without area, or repeated.")
    boundary_edges: int = Field(description="Edges with one face only.")
    nonmanifold_edges: int = Field(description="Edges with more than two faces.")
    openness: float = Field(
        default=0.0,
        description="Areas of the discs that the rims of holes would bound, over the surface area; 0 for a "
        "closed surface, and for one that was embedded before this was measured.",
    )


class Shape(BaseModel):
    """A stored shape."""

    model_config = ConfigDict(json_schema_extra={"example": SHAPE})

    id: str
    name: str
    tags: list[str]
    metadata: dict[str, JsonValue]
    format: str = Field(description="The format the file was read in.")
    bytes: int = Field(description="Size of the file.")
    sha256: str = Field(description="Of the file.")
    facts: MeshFacts
    warnings: list[str] = Field(default=[], description="What to know when it is compared.")
    embedded: bool = Field(
        description="Whether it has an embedding of the pipeline in use. Without one it is not searched."
    )
    created_at: datetime = Field(description="UTC.")
    updated_at: datetime = Field(description="UTC.")

    @classmethod
    def of(cls, record: ShapeRecord) -> "Shape":
        """The JSON of a record."""
        return cls(
            id=record.id,
            name=record.name,
            tags=list(record.tags),
            metadata=dict(record.metadata),
            format=record.format,
            bytes=record.size,
            sha256=record.sha256,
            facts=MeshFacts.model_validate(record.facts),
            warnings=warnings_of(record.facts.get("openness", 0.0)),
            embedded=record.embedded,
            created_at=record.created_at,
            updated_at=record.updated_at,
        )


class ShapePage(BaseModel):
    """Some of the shapes, oldest first."""

    model_config = ConfigDict(
        json_schema_extra={"example": {"shapes": [SHAPE], "total": 190, "next_cursor": "eyJhZnRlciI6IDUwfQ"}}
    )

    shapes: list[Shape]
    total: int = Field(description="How many shapes the filter means in all.")
    next_cursor: str | None = Field(description="Give it as `cursor` to go on; null on the last page.")

    @classmethod
    def of(cls, page: RecordPage) -> "ShapePage":
        """The JSON of a page."""
        return cls(
            shapes=[Shape.of(record) for record in page.shapes],
            total=page.total,
            next_cursor=None if page.after is None else write_cursor(page.after),
        )


class ShapeFields(BaseModel):
    """What an upload may say beside the file."""

    model_config = ConfigDict(extra="forbid")

    name: Name
    tags: Tags = []
    metadata: Metadata = {}


class ShapeChanges(BaseModel):
    """What to change. A field that is missing or null stays; one that is given replaces the old one whole."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "example": {"name": "horse.off", "tags": ["horse"], "metadata": {"checked": True}}
        },
    )

    name: Name | None = None
    tags: Tags | None = None
    metadata: Metadata | None = None

    def changes(self) -> Changes:
        """What was given."""
        return Changes(self.name, None if self.tags is None else tuple(self.tags), self.metadata)


class SpectrumArrays(BaseModel):
    """One spectral embedding of the points."""

    name: str
    eigenvalues: list[float]
    coordinates: list[list[float]] = Field(
        description="Row i is point i in the spectral domain; the first points are the samples."
    )

    @classmethod
    def of(cls, spectrum: "Spectrum") -> "SpectrumArrays":
        """The JSON of a spectrum."""
        return cls(
            name=spectrum.name,
            eigenvalues=spectrum.eigenvalues.tolist(),
            coordinates=spectrum.coordinates.tolist(),
        )


class EmbeddingArrays(BaseModel):
    """All that is kept of a shape for matching it."""

    pipeline: str = Field(description="Fingerprint of the pipeline that made it.")
    positions: list[list[float]] = Field(description="The samples, in the file's own frame and units.")
    vertices: list[int] = Field(description="The file's vertex at, or nearest to, each sample.")
    graph_edges: list[list[int]] = Field(description="Pairs of samples that the sparse graph joins.")
    graph_lengths: list[float] = Field(description="Length of each edge, in units of the shape's scale.")
    tree_edges: list[list[int]] = Field(description="The minimum spanning tree.")
    regions: list[int] = Field(description="The sample nearest to each embedded point.")
    signature: list[float] = Field(description="What shapes are shortlisted by.")
    spectra: list[SpectrumArrays]

    @classmethod
    def of(cls, embedding: "Embedding") -> "EmbeddingArrays":
        """The JSON of an embedding."""
        arrays: dict[str, Any] = {
            name: getattr(embedding, name).tolist()
            for name in (
                "positions",
                "vertices",
                "graph_edges",
                "graph_lengths",
                "tree_edges",
                "regions",
                "signature",
            )
        }
        return cls(
            pipeline=embedding.fingerprint,
            spectra=[SpectrumArrays.of(spectrum) for spectrum in embedding.spectra],
            **arrays,
        )
