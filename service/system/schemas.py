"""What the service tells of itself, as JSON."""

from importlib.metadata import version
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

VERSION = version("isoshape")


class Health(BaseModel):
    """The process answers."""

    status: Literal["ok"] = "ok"


class Readiness(BaseModel):
    """The service can do its work."""

    status: Literal["ready"] = "ready"


class PendingPipeline(BaseModel):
    """The pipeline that the settings name, while the archive is searched by another.

    `isoshape reembed` makes the embeddings that it lacks, and then has the archive searched by it.
    """

    name: str = Field(description="The name of the pipeline's parameters.")
    fingerprint: str = Field(description="A hash of these parameters and of the method's version.")
    embedded: int = Field(description="Files that have an embedding of it.")
    files: int = Field(description="Files in all; shapes on the same bytes are one.")


class Version(BaseModel):
    """Which service this is, and how it works on meshes."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "service": "isoshape",
                "version": VERSION,
                "pipeline": "default",
                "fingerprint": "3f1c9a7be2d40586",
                "method": 1,
                "pending": {
                    "name": "fine",
                    "fingerprint": "9d2be40c17a3f586",
                    "embedded": 40,
                    "files": 190,
                },
            }
        }
    )

    service: Literal["isoshape"] = "isoshape"
    version: str = Field(description="Of the service.")
    pipeline: str = Field(description="The name of the parameters that the archive is searched by.")
    fingerprint: str = Field(description="A hash of these parameters and of the method's version.")
    method: int = Field(
        description="The method's version: it goes up when the same mesh gives other numbers."
    )
    pending: PendingPipeline | None = Field(
        default=None, description="The pipeline that the settings name, unless the archive is searched by it."
    )
