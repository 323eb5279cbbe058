"""Comparisons of two shapes as clients write them."""

from typing import Annotated, Literal

from fastapi import UploadFile
from pydantic import BaseModel, ConfigDict, Field

from service.collections.dependencies import NamedInAddress
from service.errors import BadRequestFieldsError, FieldFault
from service.rendering.colours import Paint
from service.search.schemas import DENSE, CompareRequest
from service.shapes.uploads import ENDINGS_IN_WORDS

IdOrFile = Annotated[
    UploadFile | Annotated[str, Field(max_length=64)],
    Field(description=f"A mesh file, or the id of a stored shape. {ENDINGS_IN_WORDS}"),
]


class CompareForm(BaseModel):
    """Two shapes to compare, each a file or the id of a stored shape."""

    model_config = ConfigDict(extra="forbid")

    first: IdOrFile
    second: IdOrFile
    dense: bool | None = Field(default=None, description=DENSE)


class CompareParameters(NamedInAddress):
    """Options of a comparison, as query parameters."""

    format: Literal["json", "glb", "html", "npz", "png"] = Field(
        default="json",
        description="glb: both meshes side by side, with corresponding points in equal colours. html: a "
        "page with the two shapes, for a browser that may read them from this service. npz, with dense: a "
        "NumPy archive of the arrays vertices and confidence, and stretch, partnered and, where there is "
        "one, displacement. png, with dense: a picture of both shapes.",
    )
    dense: bool = Field(default=False, description=DENSE)
    paint: Paint = Field(
        default="correspondence",
        description="With dense, the colours of the GLB and of the picture. correspondence: by position on "
        "the first shape; places of the second without a partner are grey. difference: from grey over orange "
        "to brown by how far each place has moved or how much it is stretched; places without a partner "
        "are blue.",
    )


def dense_options(body: CompareForm | CompareRequest, options: CompareParameters) -> bool:
    """Whether the dense correspondence is asked for: by the body, or else by the query parameters.

    Raises
    ------
    BadRequestFieldsError
        A format or a painting needs it, and it is not asked for; or a page, which has none.
    """
    dense = options.dense if body.dense is None else body.dense
    if options.format in {"npz", "png"} and not dense:
        raise BadRequestFieldsError(FieldFault("format", f"{options.format} needs dense=true"))
    if options.paint != "correspondence" and not dense:
        raise BadRequestFieldsError(FieldFault("paint", f"{options.paint} needs dense=true"))
    if options.format == "html" and dense:
        raise BadRequestFieldsError(FieldFault("format", "html has no dense correspondence"))
    return dense
