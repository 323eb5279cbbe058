"""JSON models of the service's state."""

from importlib.metadata import version
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from service.errors import REEMBED

VERSION = version("isoshape")


class Health(BaseModel):
    """The process is alive."""

    status: Literal["ok"] = "ok"


class Readiness(BaseModel):
    """The service can process requests."""

    status: Literal["ready"] = "ready"


class PendingPipeline(BaseModel):
    """The pipeline of the settings, while another one is active.

    `isoshape reembed` computes the missing embeddings and activates the pipeline.
    """

    name: str = Field(description="The name of the pipeline's parameters.")
    fingerprint: str = Field(description="A hash of these parameters and of the method's version.")
    embedded: int = Field(description="Files with an embedding by this pipeline.")
    files: int = Field(description="All files; shapes with the same bytes count as one file.")
    message: str = Field(description="The change that `isoshape reembed` makes to the archive.")


class FileFormat(BaseModel):
    """A format of mesh files."""

    name: str = Field(description="The name in requests, as in `format=`.")
    title: str = Field(description="The name for people.")
    endings: tuple[str, ...] = Field(description="The endings of file names, without the dot.")
    media_type: str = Field(description="The media type of downloads.")
    read: bool = Field(description="Whether this service reads files of the format.")
    written: bool = Field(description="Whether meshes are exported to the format.")


class Version(BaseModel):
    """The version of the service and its pipeline."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "service": "isoshape",
                "version": VERSION,
                "pipeline": "default",
                "fingerprint": "3f1c9a7be2d40586",
                "method": 1,
                "rank_by": "cc",
                "descriptors": ["spin_images", "views", "eigenvalues", "network_views"],
                "formats": [
                    {
                        "name": "stl",
                        "title": "STL",
                        "endings": ["stl"],
                        "media_type": "model/stl",
                        "read": True,
                        "written": True,
                    }
                ],
                "pending": {
                    "name": "fine",
                    "fingerprint": "9d2be40c17a3f586",
                    "embedded": 40,
                    "files": 190,
                    "message": REEMBED,
                },
            }
        }
    )

    service: Literal["isoshape"] = "isoshape"
    version: str = Field(description="The version of the service.")
    pipeline: str = Field(description="The name of the active pipeline's parameters.")
    fingerprint: str = Field(description="A hash of these parameters and of the method's version.")
    method: int = Field(
        description="The version of the method, which increases when results for the same mesh change."
    )
    rank_by: Literal["cc", "ssd", "sim", "combined", "contextual"] = Field(
        description="The score that sorts the results of a query that names none."
    )
    descriptors: list[str] = Field(
        description="The descriptors that this service computes; `network_views` needs the extra `views`."
    )
    formats: list[FileFormat] = Field(description="The formats of mesh files.")
    pending: PendingPipeline | None = Field(
        default=None, description="The pipeline of the settings, unless it is active."
    )
