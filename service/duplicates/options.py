"""The options of a search for near-identical shapes, as clients write them."""

from typing import Literal

from pydantic import Field

from core.registration.similarity import RESIDUAL
from service.collection import CollectionNumber
from service.collections.dependencies import NamedInAddress
from service.duplicates.service import DuplicateCriteria
from service.shapes.filters import Filters


class DuplicatesOptions(NamedInAddress, Filters):
    """The shapes to search for near-identical ones, and the limits of near identity."""

    min_cc: float = Field(
        default=0.98,
        ge=-1.0,
        le=1.0,
        description="Register only pairs with at least this cc. Poses of one body pass this limit too.",
    )
    max_residual: float = Field(
        default=RESIDUAL,
        gt=0.0,
        le=0.1,
        description="The largest distance of two surfaces after the best rotation, reflection and scaling: "
        "the root mean square distance over both directions, over the square root of the area.",
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
