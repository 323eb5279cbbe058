"""How a stored file is sent back."""

from urllib.parse import quote

from core.io import ENDINGS

# Registered media types where there are any; OFF and PLY have none.
MEDIA_TYPES = {
    "stl": "model/stl",
    "obj": "model/obj",
    "glb": "model/gltf-binary",
    "3mf": "model/3mf",
    "step": "model/step",
}
OTHER_MEDIA_TYPE = "application/octet-stream"


def media_type(format: str) -> str:
    """The media type of a format."""
    return MEDIA_TYPES.get(format, OTHER_MEDIA_TYPE)


def disposition(name: str, format: str) -> str:
    """A Content-Disposition that saves the file under the shape's name (RFC 6266).

    An old client reads `filename`, in which whatever is not a harmless ASCII character is replaced; a newer
    one reads `filename*`, where every byte but letters, digits and a few signs is escaped.
    """
    if ENDINGS.get(name.lower().rpartition(".")[2]) != format:
        name = f"{name}.{format}"
    harmless = "".join(c if c.isascii() and (c.isalnum() or c in " .-_()") else "_" for c in name)
    return f"attachment; filename=\"{harmless}\"; filename*=UTF-8''{quote(name, safe='')}"


def entity_tag(sha256: str) -> str:
    """The ETag of the bytes."""
    return f'"{sha256}"'


def is_known(if_none_match: str | None, tag: str) -> bool:
    """Whether the client says that it has the bytes with a tag already."""
    if if_none_match is None:
        return False
    given = [part.strip().removeprefix("W/") for part in if_none_match.split(",")]
    return "*" in given or tag in given
