"""Changes to many shapes as JSON."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictBool

from service.collection import NAME
from service.shapes.fields import Metadata, Tags, storable_text
from service.shapes.schemas import Filters

REFUSED = 100
"""Refusals that an answer tells."""


RULES = 100
"""Rules of a collection."""

Condition = Annotated[
    str, AfterValidator(storable_text), Field(min_length=2, max_length=255, pattern="^[^=\\x00]+=[^\\x00]*$")
]


class NewMetadataRules(BaseModel):
    """The rules that a collection gets."""

    model_config = ConfigDict(extra="forbid")

    rules: dict[Condition, Tags] = Field(
        max_length=RULES,
        description="Tags by conditions on the metadata, written key=value as in a filter. The value may "
        "have the wildcards *, ? and [...]; upper and lower case are equal.",
        examples=[{"material=steel*": ["steel"]}],
    )


class MetadataRules(BaseModel):
    """The rules of a collection."""

    rules: dict[str, list[str]] = Field(description="Tags by conditions on the metadata.")


class RulesApplied(MetadataRules):
    """The rules of a collection, and how many stored shapes got tags by them."""

    changed: int


class BulkChange(Filters):
    """The filter of the shapes to change, and the changes."""

    tag: Tags = Field(default=[], description="Only shapes with all these tags.")
    add_tags: Tags = Field(default=[])
    remove_tags: Tags = Field(default=[])
    set_metadata: Metadata = Field(default={}, description="Entries that the metadata get, or get anew.")
    remove_metadata: list[str] = Field(default=[], max_length=64, description="Keys that the metadata lose.")
    collection: str | None = Field(
        default=None,
        description="Move the shapes, which keep their ids, to this collection. The key must allow both.",
        json_schema_extra={"pattern": f"^{NAME}$"},
    )
    dry_run: StrictBool = Field(default=True, description="Count the shapes, and change nothing.")


class Refused(BaseModel):
    """A shape that stays as it is, and why."""

    id: str
    name: str
    detail: str


class BulkChanged(BaseModel):
    """The numbers of the shapes of a change."""

    matched: int = Field(description="The number of shapes that pass the filter.")
    changed: int = Field(description="The number of shapes that changed or, in a dry run, would change.")
    refused: list[Refused] = Field(
        description=f"The first {REFUSED} shapes that cannot be changed: they would have too many tags "
        "or metadata, or the other collection has the same file under the same name."
    )
