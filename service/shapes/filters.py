"""Which shapes are meant, as clients write it: alike where shapes are listed and where they are searched."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from service.collection import CollectionNumber
from service.errors import BadRequestFieldsError, FieldFault
from service.shapes.fields import ListedTags, clean_text
from service.shapes.records import ShapeFilter

METADATA_FILTERS = 32


class Filters(BaseModel):
    """Only shapes for which all of it holds."""

    model_config = ConfigDict(extra="forbid")

    tag: ListedTags = Field(
        default=[],
        description="Only shapes that have this tag; all of them, if repeated or separated by commas.",
        examples=[["animal"]],
    )
    name: Annotated[str, AfterValidator(clean_text)] | None = Field(
        default=None, max_length=255, description="Only shapes with this text in their name, in either case."
    )
    metadata: list[Annotated[str, Field(json_schema_extra={"pattern": "^[^=]+="})]] = Field(
        default=[],
        max_length=METADATA_FILTERS,
        description="Only shapes whose metadata holds this, as key=value; all of them, if repeated. "
        "A value that is not text is written as in JSON.",
        examples=[["source=scan"]],
    )

    def filtered(self, collection: CollectionNumber) -> ShapeFilter:
        """What the parameters say of the shapes of a collection."""
        metadata = []
        for pair in self.metadata:
            key, equals, value = pair.partition("=")
            if not (key and equals):
                raise BadRequestFieldsError(FieldFault("metadata", "must be written key=value"))
            metadata.append((key, value))
        return ShapeFilter(collection, tuple(self.tag), self.name, tuple(metadata))
