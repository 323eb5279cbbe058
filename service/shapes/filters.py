"""Filters of shapes as clients write them: the same for lists, searches and duplicates."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from service.collection import CollectionNumber
from service.errors import BadRequestFieldsError, FieldFault
from service.shapes.fields import ListedTags, clean_text
from service.shapes.records import ShapeFilter

METADATA_FILTERS = 32


class Filters(BaseModel):
    """Conditions on shapes; a shape must satisfy all of them."""

    model_config = ConfigDict(extra="forbid")

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
    metadata: list[Annotated[str, Field(json_schema_extra={"pattern": "^[^=]+="})]] = Field(
        default=[],
        max_length=METADATA_FILTERS,
        description="Only shapes with this entry in their metadata, as key=value; with all entries, if "
        "repeated. Values other than text are written as JSON.",
        examples=[["source=scan"]],
    )

    def filtered(self, collection: CollectionNumber) -> ShapeFilter:
        """The filter of the shapes of a collection.

        Raises
        ------
        BadRequestFieldsError
            A condition on metadata is not written key=value.
        """
        metadata = []
        for pair in self.metadata:
            key, equals, value = pair.partition("=")
            if not (key and equals):
                raise BadRequestFieldsError(FieldFault("metadata", "must be written key=value"))
            metadata.append((key, value))
        return ShapeFilter(collection, tuple(self.tag), self.name, tuple(metadata))
