"""The forms of uploads: files and text fields in, checked values out."""

from typing import Annotated, Literal

from fastapi import UploadFile
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Json,
    ValidationInfo,
    WithJsonSchema,
)

from core.io import FORMATS
from service.shapes.fields import (
    METADATA_BYTES,
    METADATA_DEPTH,
    METADATA_KEYS,
    TAGS,
    ListedTags,
    Metadata,
    base_name,
    clean_name,
)

_ALWAYS, _EXTRA = (
    [ending for known in FORMATS.values() if bool(known.package) == extra for ending in known.endings]
    for extra in (False, True)
)
ENDINGS_IN_WORDS = (
    f"The ending of the file's name is its format: {', '.join(sorted(_ALWAYS))}, and {' and '.join(_EXTRA)} "
    "where the service has the extra for them."
)
"""The formats of uploads, for the documentation."""

MeshFile = Annotated[
    UploadFile,
    Field(description=f"The mesh. {ENDINGS_IN_WORDS} 3MF and STEP are read in millimetres."),
]


def _named_after_file(name: object, info: ValidationInfo) -> object:
    return name or base_name(info.data["file"].filename or "")


def _empty_object(text: object) -> object:
    return text or "{}"


FormName = Annotated[
    str,
    BeforeValidator(_named_after_file),
    AfterValidator(clean_name),
    Field(
        default_factory=str,
        validate_default=True,
        description="The name of the shape: 1 to 255 characters. Unless given, the file's own name, without "
        "its folders.",
    ),
]
FormTags = Annotated[
    ListedTags,
    Field(
        description=f"Up to {TAGS} tags: the field repeated, one field with commas, or both.",
        default_factory=list,
        json_schema_extra={"maxItems": TAGS},
    ),
]
FormMetadata = Annotated[
    Json[Metadata],
    BeforeValidator(_empty_object),
    WithJsonSchema({"type": "string", "contentMediaType": "application/json"}),
    Field(
        default_factory=dict,
        description=f"A JSON object, as text: up to {METADATA_KEYS} keys, {METADATA_DEPTH} levels and "
        f"{METADATA_BYTES} bytes.",
        examples=['{"source": "scan", "year": 2024}'],
    ),
]


class MeshUpload(BaseModel):
    """A mesh."""

    file: MeshFile


class Replacement(MeshUpload):
    """A mesh, and nothing else."""

    model_config = ConfigDict(extra="forbid")


class ShapeUpload(Replacement):
    """A mesh to store, and the text that people write about it."""

    name: FormName
    tags: FormTags
    metadata: FormMetadata
    split: Literal["parts"] | None = Field(
        default=None,
        description="`parts`: a STEP or 3MF is one shape, and each of its distinct parts is another, with "
        "the metadata `assembly` (the name of the whole shape), `assembly_path` (the names from the root to "
        "the first instance of the part) and `instances`. The service stores all of them or none. A file of "
        "one part or of another format is one shape.",
    )
