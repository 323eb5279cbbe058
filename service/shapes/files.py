"""Headers for downloads of stored files."""

from urllib.parse import quote

from core.io import FORMATS


def disposition(name: str, format: str) -> str:
    """A Content-Disposition that saves the file under the shape's name (RFC 6266).

    Old clients read `filename`, where an underscore replaces unsafe characters; newer ones read `filename*`,
    where unsafe bytes are percent-encoded.
    """
    if name.lower().rpartition(".")[2] not in FORMATS[format].endings:
        name = f"{name}.{format}"
    harmless = "".join(c if c.isascii() and (c.isalnum() or c in " .-_()") else "_" for c in name)
    return f"attachment; filename=\"{harmless}\"; filename*=UTF-8''{quote(name, safe='')}"


def entity_tag(sha256: str) -> str:
    """The ETag of bytes with a SHA-256."""
    return f'"{sha256}"'


def is_known(if_none_match: str | None, tag: str) -> bool:
    """Whether an If-None-Match header contains the tag, or is `*`."""
    if if_none_match is None:
        return False
    given = [part.strip().removeprefix("W/") for part in if_none_match.split(",")]
    return "*" in given or tag in given
