"""Shapes as JSON: filters as clients write them, pages with their cursors, shapes and embeddings."""

import base64
import json
import math
import re
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, JsonValue

from core.io import FORMATS
from core.parameters import INCOMPLETE
from service.collection import NAME, CollectionRecord
from service.errors import BadRequestFieldsError, FieldFault
from service.shapes.fields import ListedTags, Metadata, Name, Tags, clean_text, storable_text
from service.shapes.records import Position, Range, ShapeFilter, ShapeRecord, Sort, StoredShape

METADATA_FILTERS = 32

NUMBER = r"[0-9]+(\.[0-9]+)?([eE][+-]?[0-9]{1,3})?"
RANGE = rf"^({NUMBER}\.\.({NUMBER})?|\.\.{NUMBER})$"


def range_of(text: str) -> Range:
    """Return the least and the greatest value of a range, written min..max.

    Raise ValueError if it is written otherwise, has no side, or its least value exceeds its greatest.
    """
    if re.search(RANGE, text) is None or text.endswith("\n"):
        raise ValueError("must be written min..max, with numbers of 0 or more; one of them may be left out")
    least, greatest = text.split("..")
    values = float(least or 0.0), float(greatest or math.inf)
    if values[0] > values[1]:
        raise ValueError(f"the least value {least} exceeds the greatest value {greatest}")
    return values


SizeRange = Annotated[
    str,
    AfterValidator(lambda text: range_of(text) and text),
    Field(max_length=64, json_schema_extra={"pattern": RANGE}),
]


def _known_format(name: str) -> str:
    if name not in FORMATS:
        raise ValueError(f"must be one of {', '.join(sorted(FORMATS))}")
    return name


class Filters(BaseModel):
    """Conditions on shapes; a shape must satisfy all of them."""

    model_config = ConfigDict(extra="forbid")

    q: Annotated[str, AfterValidator(clean_text)] | None = Field(
        default=None,
        max_length=255,
        description="Only shapes that have all these words in their name, tags or metadata; for a key with "
        "full access, also in the paths of their files. Upper and lower case, accents, and spellings such as "
        "ä, ae and a are equal; a word may be the beginning of another one or, of 4 letters or more, a part "
        "of it; of 5 letters or more it may have one spelling mistake.",
        examples=["phone stand"],
    )
    tag: ListedTags = Field(
        default=[],
        description="Only shapes with this tag; with all tags, if repeated or separated by commas.",
        examples=[["animal"]],
    )
    name: Annotated[str, AfterValidator(clean_text)] | None = Field(
        default=None,
        max_length=255,
        description="Only shapes whose name contains this text; upper and lower case are equal.",
    )
    metadata: list[
        Annotated[
            str, AfterValidator(storable_text), Field(json_schema_extra={"pattern": "^[^=\\x00]+=[^\\x00]*$"})
        ]
    ] = Field(
        default=[],
        max_length=METADATA_FILTERS,
        description="Only shapes with this entry in their metadata, as key=value; with all entries, if "
        "repeated. Values other than text are written as JSON.",
        examples=[["source=scan"]],
    )
    file_format: Annotated[str, AfterValidator(_known_format)] | None = Field(
        default=None,
        description="Only shapes whose file has this format, named as in the `format` of a shape.",
        examples=["stl"],
        json_schema_extra={"enum": [*sorted(FORMATS)]},
    )
    area: SizeRange | None = Field(
        default=None,
        description="Only shapes whose surface area is in this range, written min..max, in squared units of "
        "the files; one side may be left out.",
        examples=["100..250"],
    )
    volume: SizeRange | None = Field(
        default=None,
        description="Only shapes whose volume is in this range, in cubed units of the files. Open surfaces "
        "have no volume.",
        examples=["1000.."],
    )
    length: SizeRange | None = Field(
        default=None,
        description="Only shapes whose bounding box has a largest extent in this range, in units of the "
        "files.",
        examples=["..60"],
    )

    def filtered(self, collection: CollectionRecord) -> ShapeFilter:
        """Return the filter of the shapes of a collection; words are those of paths too if it shows them.

        Raise BadRequestFieldsError if a condition on metadata is not written key=value.
        """
        metadata = []
        for pair in self.metadata:
            key, equals, value = pair.partition("=")
            if not (key and equals):
                raise BadRequestFieldsError(FieldFault("metadata", "must be written key=value"))
            metadata.append((key, value))
        sizes = {"area": self.area, "volume": self.volume, "length": self.length}
        ranges: dict[str, Any] = {name: range_of(text) for name, text in sizes.items() if text is not None}
        return ShapeFilter(
            collection.number,
            tuple(self.tag),
            self.name,
            tuple(metadata),
            self.file_format,
            words=self.q or None,
            by_paths=bool(self.q) and collection.shows_paths,
            **ranges,
        )


class Page(BaseModel):
    """The place of a page in its list."""

    total: int = Field(description="The number of items over all pages.")
    next_cursor: str | None = Field(description="The `cursor` of the next page; null on the last page.")


def write_cursor(after: int, name: str | None = None, points: int | None = None) -> str:
    """Return the cursor of the page after the row with a number, and a name or points in a list by these."""
    content = {"after": after, "name": name, "points": points}
    given = {key: value for key, value in content.items() if value is not None}
    return base64.urlsafe_b64encode(json.dumps(given).encode()).decode().rstrip("=")


def read_cursor(cursor: str | None) -> int:
    """Return the number in a cursor; 0 for the first page. It raises the errors of `read_position`."""
    position = read_position(cursor, "oldest")
    return 0 if position is None else position.number


def read_position(cursor: str | None, sort: Sort) -> Position | None:
    """Return the position in a cursor of a list with an order; None for the first page.

    Raise BadRequestFieldsError if the cursor is malformed, or of a list with another order.
    """
    if cursor is None:
        return None
    try:
        content = json.loads(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
        number, name, points = content["after"], content.get("name"), content.get("points")
        if name is not None:
            storable_text(name)
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError):
        number = name = points = None
    if type(number) is not int or not 0 <= number < 2**63:
        raise BadRequestFieldsError(FieldFault("cursor", "this service did not create the cursor"))
    if (isinstance(name, str), type(points) is int) != (sort == "name", sort == "relevance"):
        message = f"the cursor belongs to a list in another order than sort={sort}"
        raise BadRequestFieldsError(FieldFault("cursor", message))
    return Position(number, name, points)


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
        "boundary_ratio": 0.0,
        "bounding_box": [1.213, 0.954, 0.318],
        "file_box": [0.344, 1.226, 0.961],
        "gyration_radii": [0.312, 0.204, 0.087],
        "closed": True,
    },
    "unit": "",
    "warnings": [],
    "embedded": True,
    "created_at": "2026-01-31T12:00:00Z",
    "updated_at": "2026-01-31T12:00:00Z",
}


def warnings_of(boundary_ratio: float) -> list[str]:
    """Return warnings for comparisons with a surface."""
    if boundary_ratio <= INCOMPLETE:
        return []
    return [
        f"the surface looks incomplete: its open rims would bound {100 * boundary_ratio:.0f} % of its area. "
        "A query finds what it is a part of with rank_by=combined or partial=true"
    ]


class MeshFacts(BaseModel):
    """Measures of the mesh, in the unit of the shape."""

    vertices: int = Field(description="Vertices in the file.")
    faces: int = Field(description="Faces in the file.")
    area: float = Field(description="Surface area.")
    volume: float = Field(description="Volume; it has a meaning only if `closed` is true.")
    scale: float = Field(description="Root mean square distance of the surface from its centroid.")
    components: int = Field(description="Number of connected components.")
    merged_vertices: int = Field(description="Vertices merged with another at the same position.")
    dropped_faces: int = Field(description="Removed faces: without area, or repeated.")
    boundary_edges: int = Field(description="Edges of one face only.")
    nonmanifold_edges: int = Field(description="Edges of more than two faces.")
    boundary_ratio: float = Field(
        description="The areas of discs with the lengths of the boundary loops, over the surface area, at "
        "most 1; 0 for a closed surface, and for one of several pieces none of which has 3/4 of the area."
    )
    bounding_box: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(
        description="The sides of the least box around the mesh, in any orientation, the largest first."
    )
    file_box: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(
        description="The extents of the mesh along the x, y and z axes of the file."
    )
    gyration_radii: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(
        description="The principal radii of gyration of the solid, the largest first; they have a meaning "
        "only if `closed` is true."
    )
    closed: bool = Field(
        default=False,
        description="Whether the surface has no boundary edges, so that it encloses its volume.",
    )


class MeasuredMesh(BaseModel):
    """A mesh by its measures."""

    facts: MeshFacts
    unit: Literal["mm", ""] = Field(
        default="",
        description="The unit of the lengths in `facts`: the millimetre for files of formats that state one, "
        "whatever it is; empty where it is not stated.",
    )

    @classmethod
    def in_format(cls, facts: Mapping[str, Any], format: str) -> "MeasuredMesh":
        """Return the JSON of the facts of a file of a format, as they are stored."""
        shown = {**facts, "closed": facts["boundary_edges"] == 0}
        return cls.model_validate({"facts": shown, "unit": FORMATS[format].unit})


class FileAndFields(BaseModel):
    """The file of a shape and its fields."""

    id: str
    name: str
    tags: list[str]
    metadata: dict[str, JsonValue]
    format: str = Field(description="The format of the file.")
    bytes: int = Field(description="Size of the file.")
    sha256: str = Field(description="SHA-256 of the file, in hexadecimal digits.")
    created_at: datetime = Field(description="UTC.")


class Shape(MeasuredMesh, FileAndFields):
    """A stored shape."""

    model_config = ConfigDict(json_schema_extra={"example": SHAPE})

    warnings: list[str] = Field(
        default=[], description="Warnings of the file's reader, and for comparisons with the shape."
    )
    embedded: bool = Field(
        description="Whether the shape has an embedding of the active pipeline. Queries skip shapes without "
        "one."
    )
    updated_at: datetime = Field(description="UTC.")

    @classmethod
    def of(cls, record: ShapeRecord) -> "Shape":
        """Return the JSON of a record."""
        mesh = MeasuredMesh.in_format(record.facts, record.format)
        warnings = [*record.facts["warnings"], *warnings_of(mesh.facts.boundary_ratio)]
        return cls(**{**vars(record), **dict(mesh), "warnings": warnings})


class ShapePage(Page):
    """A page of the shapes that pass the filter."""

    shapes: list[Shape]


class DeletedShape(FileAndFields):
    """A deleted shape that can be restored."""

    deleted_at: datetime = Field(description="UTC.")
    gone_at: datetime = Field(description="The time until which the shape can be restored. UTC.")

    @classmethod
    def of(cls, record: ShapeRecord, keep: timedelta) -> "DeletedShape":
        """Return the JSON of a record."""
        assert record.deleted_at is not None
        return cls(**vars(record), gone_at=record.deleted_at + keep)


class DeletedShapePage(Page):
    """A page of the shapes that can be restored, in the order of their deletion."""

    shapes: list[DeletedShape]
    undo_days: float = Field(description="How many days after its deletion a shape can be restored.")


PART: dict[str, Any] = {
    **SHAPE,
    "id": "5f0d8a5e-7a0c-4c5b-9a53-0c2f4bb0a7de",
    "name": "gearbox.step/bolt",
    "format": "3mf",
    "metadata": {"assembly": "gearbox.step", "assembly_path": "gearbox/housing:1/bolt:1", "instances": 12},
    "created": True,
    "changed": [],
}


class UploadedShape(Shape):
    """A shape after an upload."""

    model_config = ConfigDict(json_schema_extra={"example": {**SHAPE, "created": True, "changed": []}})

    created: bool = Field(description="Whether the upload stored the shape; false if it was there before.")
    changed: list[Literal["tags", "metadata"]] = Field(
        description="The fields of a shape that was there before to which the upload added something."
    )

    @classmethod
    def of_stored(cls, stored: StoredShape) -> "UploadedShape":
        """Return the JSON of a shape after an upload."""
        shape = dict(Shape.of(stored.shape))
        return cls(**shape, created=stored.created, changed=[*stored.changed])


class Assembly(UploadedShape):
    """The shape of a whole assembly, and those of its parts."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {**SHAPE, "name": "gearbox.step", "created": True, "changed": [], "parts": [PART]}
        }
    )

    parts: list[UploadedShape] = Field(
        description="The shapes of the distinct parts in the order of the file; empty for a file of one part."
    )

    @classmethod
    def of_assembly(cls, stored: Sequence[StoredShape]) -> "Assembly":
        """Return the JSON of an assembly after the upload: of the whole, and of its parts."""
        whole, *parts = map(UploadedShape.of_stored, stored)
        return cls(**dict(whole), parts=parts)


class ShapeFields(BaseModel):
    """The text that people write about a shape."""

    model_config = ConfigDict(extra="forbid")

    name: Name
    tags: Tags = []
    metadata: Metadata = {}


class ShapeChanges(BaseModel):
    """Changes to a shape. A given field replaces the whole value; a missing or null field changes nothing."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "example": {"name": "horse.off", "tags": ["horse"], "metadata": {"checked": True}}
        },
    )

    name: Name | None = None
    tags: Tags | None = None
    metadata: Metadata | None = None
    collection: str | None = Field(
        default=None,
        description="Move the shape, which keeps its id, to this collection. The key must allow both.",
        json_schema_extra={"pattern": f"^{NAME}$"},
    )


class SpectrumArrays(BaseModel):
    """The points in one spectral domain."""

    name: str
    eigenvalues: list[float]
    coordinates: list[list[float]] = Field(
        description="Row i has the coordinates of point i; the samples are the first points."
    )

    @classmethod
    def of(cls, spectrum: "Spectrum") -> "SpectrumArrays":
        """Return the JSON of a spectrum."""
        return cls(
            name=spectrum.name,
            eigenvalues=spectrum.eigenvalues.tolist(),
            coordinates=spectrum.coordinates.tolist(),
        )


ARRAYS = ("positions", "vertices", "graph_edges", "graph_lengths", "tree_edges", "regions", "signature")
"""The names of an embedding's arrays, without those of its spectra."""


class EmbeddingArrays(BaseModel):
    """The embedding of a shape: the arrays that the service matches it by."""

    pipeline: str = Field(description="Fingerprint of the pipeline that computed the embedding.")
    positions: list[list[float]] = Field(
        description="Positions of the samples, in the frame of the file and the unit of the shape."
    )
    vertices: list[int] = Field(description="The vertex of the file at each sample, or nearest to it.")
    graph_edges: list[list[int]] = Field(description="Edges of the sparse graph: pairs of samples.")
    graph_lengths: list[float] = Field(description="Length of each edge, in units of the scale of the shape.")
    tree_edges: list[list[int]] = Field(description="Edges of the minimum spanning tree: pairs of samples.")
    regions: list[int] = Field(description="The nearest sample of each embedded point.")
    signature: list[float] = Field(description="The signature, by which the service makes shortlists.")
    spectra: list[SpectrumArrays]

    @classmethod
    def of(cls, embedding: "Embedding") -> "EmbeddingArrays":
        """Return the JSON of an embedding."""
        arrays: dict[str, Any] = {name: getattr(embedding, name).tolist() for name in ARRAYS}
        return cls(
            pipeline=embedding.fingerprint,
            spectra=[SpectrumArrays.of(spectrum) for spectrum in embedding.spectra],
            **arrays,
        )


def number_in_words(value: float) -> str:
    """Return a number with four digits, and without an exponent below a million."""
    return f"{float(f'{value:.4g}'):g}"


def box_in_words(facts: MeshFacts) -> str:
    """Write length, width and height: "100 × 20 × 10"."""
    return " × ".join(map(number_in_words, facts.bounding_box))


def in_unit(size: str, unit: str) -> str:
    """Return a size with its unit, if it has one."""
    return f"{size} {unit}".rstrip()


def volume_in_words(facts: MeshFacts) -> str:
    """Return the volume, or that the surface is open and has none."""
    return number_in_words(facts.volume) if facts.closed else "open surface"
