"""The OpenAPI document of the service, created without starting the service."""

import json
from pathlib import Path
from typing import Any

from service.app import create_app
from service.settings import Settings


def document() -> dict[str, Any]:
    """The OpenAPI document, which does not depend on settings or environment."""
    return create_app(Settings.model_construct()).openapi()


def write(path: Path) -> None:
    """Write the document to a file, always with the same bytes for the same service."""
    path.write_text(
        json.dumps(document(), indent=2, sort_keys=True, ensure_ascii=False) + "\n", encoding="utf-8"
    )
