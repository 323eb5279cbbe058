"""The OpenAPI document of the service, created without starting the service."""

import json
from typing import Any

from service.app import create_app
from service.settings import Settings


def document() -> dict[str, Any]:
    """Return the OpenAPI document, which does not depend on settings or environment."""
    return create_app(Settings.model_construct()).openapi()


def text() -> str:
    """Return the document as a file, always the same for the same service."""
    return json.dumps(document(), indent=2, sort_keys=True, ensure_ascii=False) + "\n"
