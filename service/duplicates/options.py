"""The options of a search for near-identical shapes, as clients write them."""

from typing import Literal

from pydantic import Field

from core.registration.similarity import RESIDUAL
from service.collection import CollectionNumber
from service.collections.dependencies import NamedInAddress
from service.duplicates.judgements import MIN_CC
from service.duplicates.service import DuplicateCriteria
from service.shapes.filters import Filters


class DuplicatesOptions(NamedInAddress, Filters):
    """The shapes to search for near-identical ones, and the limits of near identity."""

    min_cc: float = Field(
        default=MIN_CC,
        ge=MIN_CC,
        le=1.0,
        description="Only pairs with at least this cc. Shapes are judged with the default, so that no lower "
        "value is possible. Poses of one body pass this limit too.",
    )
    max_residual: float = Field(
        default=RESIDUAL,
        gt=0.0,
        le=RESIDUAL,
        description="The largest distance of two surfaces after the best rotation, reflection and scaling: "
        "the root mean square distance over both directions, over the square root of the area. Shapes are "
        "judged with the default, so that no higher value is possible.",
    )
    variants: bool = Field(
        default=False,
        description="Also join variants: rigid copies but for a local difference, such as one hole more.",
    )
    format: Literal["json", "csv"] = Field(default="json", description="csv: one row for each shape.")

    def wanted(self, collection: CollectionNumber) -> DuplicateCriteria:
        """The search in a collection."""
        return DuplicateCriteria(
            self.filtered(collection), self.min_cc, self.max_residual, variants=self.variants
        )
