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
            }
        }
    )

    service: Literal["isoshape"] = "isoshape"
    version: str = Field(description="Of the service.")
    pipeline: str = Field(description="The name of the pipeline's parameters.")
    fingerprint: str = Field(description="A hash of these parameters and of the method's version.")
    method: int = Field(
        description="The method's version: it goes up when the same mesh gives other numbers."
    )
