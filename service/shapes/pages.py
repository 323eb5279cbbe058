"""The cursor of a page: opaque to clients, so that what it holds may change."""

import base64
import binascii
import json

from service.errors import BadRequestFieldsError, FieldFault


def write_cursor(after: int) -> str:
    """The cursor of the page that follows the shape with a number."""
    return base64.urlsafe_b64encode(json.dumps({"after": after}).encode()).decode().rstrip("=")


def read_cursor(cursor: str | None) -> int:
    """The number that a cursor holds; 0 before the first page.

    Raises
    ------
    BadRequestFieldsError
        The service did not write it.
    """
    if cursor is None:
        return 0
    try:
        content = json.loads(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
        after = content["after"]
    except (binascii.Error, ValueError, TypeError, KeyError):
        after = None
    if not isinstance(after, int) or not 0 <= after < 2**63:
        raise BadRequestFieldsError(FieldFault("cursor", "not one that this service gave"))
    return after
