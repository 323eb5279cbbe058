"""The options of a search for near-identical shapes, as clients write them."""

from typing import Literal

from pydantic import Field

from core.registration.similarity_icp import RESIDUAL
from service.collection import CollectionNumber
from service.collections.dependencies import NamedInAddress
from service.duplicates.service import Wanted
from service.shapes.filters import Filters


class DuplicatesOptions(NamedInAddress, Filters):
    """Among which shapes to look for near-identical ones, and what these are."""

    min_cc: float = Field(
        default=0.98,
        ge=-1.0,
        le=1.0,
        description="Only pairs of at least this cc are laid onto each other. Poses of one body pass it too.",
    )
    max_residual: float = Field(
        default=RESIDUAL,
        gt=0.0,
        le=0.1,
        description="How far apart two surfaces may lie at most after the best rotation, reflection and "
        "scaling: the root mean square distance both ways, over the root of the area.",
    )
    format: Literal["json", "csv"] = Field(default="json", description="csv has a row a shape.")

    def wanted(self, collection: CollectionNumber) -> Wanted:
        """What to look for in a collection."""
        return Wanted(self.filtered(collection), self.min_cc, self.max_residual)
