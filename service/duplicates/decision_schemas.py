"""Decisions on near-identical shapes, and their merges, as JSON."""

from datetime import datetime
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictBool

from core.ranking.likeness import Copy
from service.duplicates.records import Decision
from service.shapes.fields import Id, Tags, clean_text
from service.shapes.schemas import SHAPE, Filters, Page, Shape

MOST_SHAPES = 100
"""Shapes of one decision or merge."""

MOST_LEFT = 1_000
"""Groups that an answer names, of those that cannot be merged."""

OTHER = "6f1d1f52-0c57-4f0e-8c0b-0d4e6a1f9b22"


def _distinct(ids: list[str]) -> list[str]:
    if len(set(ids)) < len(ids):
        raise ValueError("each id is given once")
    return ids


ShapeIds = Annotated[
    list[Id],
    AfterValidator(_distinct),
    Field(
        min_length=2,
        max_length=MOST_SHAPES,
        description="The ids of the shapes.",
        json_schema_extra={"uniqueItems": True},
    ),
]
Keep = Literal["oldest", "newest", "largest"]
"""The shape of a group that a merge keeps: the one stored first or last, or the one with the most faces."""


class Reasoned(BaseModel):
    """Who decides, and why."""

    model_config = ConfigDict(extra="forbid")

    decided_by: Annotated[str, AfterValidator(clean_text)] | None = Field(
        default=None,
        max_length=64,
        description="The name of the person who decides. Unless given, the first digits of the SHA-256 of "
        "the key.",
    )
    reason: Annotated[str, AfterValidator(clean_text)] = Field(default="", max_length=1024)


class GroupDecision(Reasoned):
    """A decision on every pair of some shapes."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={"example": {"shapes": [SHAPE["id"], OTHER], "decision": "different"}},
    )

    shapes: ShapeIds
    decision: Decision = Field(
        description="same: one shape; variant: versions of one; different: unlike in what counts; ignore: no "
        "duplicates to look at. None of them is shown as a duplicate again until a file is replaced."
    )


class LeftGroup(BaseModel):
    """A group that cannot be merged, or whose merge cannot be undone."""

    shapes: list[str] = Field(description="The ids of its shapes.")
    reason: str = Field(description="The reason why it is left, in words.")


class Decided(BaseModel):
    """Decided or merged groups."""

    id: str | None = Field(
        description="The id, by which the decision is deleted or the merge undone; null after a dry run, and "
        "after a merge where deleted shapes cannot be restored."
    )
    groups: int = Field(description="The number of decided or merged groups.")
    pairs: int = Field(description="The number of pairs of shapes in them, or of decided pairs of files.")
    left: list[LeftGroup] = Field(
        default=[],
        max_length=MOST_LEFT,
        description=f"The groups that cannot be merged, the first {MOST_LEFT} of them.",
    )


class DecidedSide(BaseModel):
    """A file of a decision, and the stored shapes that have it, if any."""

    sha256: str
    shapes: dict[str, str] = Field(description="The names of the shapes by their ids.")


class DecidedPair(BaseModel):
    """A decision on two files."""

    id: str
    decision: Decision
    decided_by: str | None
    reason: str
    decided_at: datetime
    first: DecidedSide
    second: DecidedSide


class DecisionPage(Page):
    """Decided pairs, the oldest decision first."""

    decisions: list[DecidedPair]


class Merge(BaseModel):
    """Shapes to merge into one."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"example": {"shapes": [SHAPE["id"], OTHER], "keep": "oldest"}}
    )

    shapes: ShapeIds
    keep: Id = Field(
        default="oldest",
        description="The shape that stays: the id of one of the shapes, the oldest, the newest, or the one "
        "with the most faces (largest).",
    )


class MergedShape(BaseModel):
    """The shape that stays after a merge."""

    shape: Shape
    id: str | None = Field(
        description="The id, by which the merge is undone; null where deleted shapes cannot be restored."
    )


class MergedGroup(BaseModel):
    """A merge of one group, which can be undone."""

    id: str = Field(description="The id, which all groups merged by one call to POST /duplicates/rule share.")
    shape: str = Field(description="The id of the shape that stayed.")
    deleted: list[str] = Field(description="The ids of the deleted shapes.")
    merged_at: datetime


class MergePage(Page):
    """Merged groups, the oldest merge first."""

    merges: list[MergedGroup]


class Act(BaseModel):
    """A decision or a merge that can be undone."""

    id: str
    action: Decision | Literal["merge"]
    decided_by: str | None = Field(default=None, description="Unless it is a merge.")
    reason: str = ""
    decided_at: datetime
    count: int = Field(description="The number of its pairs of files, or of merged groups.")
    names: list[str] = Field(description="The names of the shapes of its first pair, or of its first group.")


class Acts(BaseModel):
    """Decisions and merges, the latest first."""

    acts: list[Act]


class Undone(BaseModel):
    """The undo of a merge."""

    groups: int = Field(description="The number of groups that are as before the merge.")
    left: list[LeftGroup] = Field(
        max_length=MOST_LEFT,
        description=f"The groups whose merge cannot be undone, the first {MOST_LEFT} of them.",
    )


class Rule(Reasoned, Filters):
    """Groups of near-identical shapes, and what is done with all of them.

    The groups are those of GET /duplicates with the same options.
    """

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={"example": {"action": "merge", "likeness": ["same"], "dry_run": True}},
    )

    tag: Tags = Field(default=[], description="Only shapes with all these tags.")
    action: Decision | Literal["merge"]
    likeness: list[Copy] = Field(
        default=["same"],
        min_length=1,
        description="Only groups whose shapes all have one of these likenesses to the first.",
    )
    scaled: StrictBool = False
    mirrored: StrictBool = True
    variants: StrictBool = False
    keep: Keep = Field(default="oldest", description="With merge: the shape of each group that stays.")
    dry_run: StrictBool = Field(default=True, description="Count the groups, and change nothing.")
