"""Cursors of pages: opaque to clients, so that their content may change."""

import base64
import binascii
import json

from service.errors import BadRequestFieldsError, FieldFault


def write_cursor(after: int) -> str:
    """The cursor of the page after the shape with a number."""
    return base64.urlsafe_b64encode(json.dumps({"after": after}).encode()).decode().rstrip("=")


def read_cursor(cursor: str | None) -> int:
    """The number in a cursor; 0 for the first page.

    Raises
    ------
    BadRequestFieldsError
        The cursor is malformed.
    """
    if cursor is None:
        return 0
    try:
        content = json.loads(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
        after = content["after"]
    except (binascii.Error, ValueError, TypeError, KeyError):
        after = None
    if not isinstance(after, int) or not 0 <= after < 2**63:
        raise BadRequestFieldsError(FieldFault("cursor", "this service did not create the cursor"))
    return after
