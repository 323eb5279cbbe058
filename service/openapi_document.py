"""The OpenAPI document of the service, made without starting it."""

import json
from pathlib import Path
from typing import Any

from service.app import create_app
from service.settings import Settings


def document() -> dict[str, Any]:
    """The document of the service; settings and environment change nothing in it."""
    return create_app(Settings.model_construct()).openapi()


def write(path: Path) -> None:
    """Write the document to a file; the same service always writes the same bytes."""
    path.write_text(
        json.dumps(document(), indent=2, sort_keys=True, ensure_ascii=False) + "\n", encoding="utf-8"
    )
