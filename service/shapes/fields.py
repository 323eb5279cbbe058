"""The text that people write about a shape: name, tags and metadata."""

import json
import math
import unicodedata
from collections.abc import Iterable, Iterator
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, JsonValue

NAME_CHARACTERS = 255
TAG_CHARACTERS = 64
TAGS = 32
METADATA_BYTES = 16 * 1024
METADATA_KEYS = 64
METADATA_KEY_CHARACTERS = 128
METADATA_DEPTH = 8


def clean_text(text: str) -> str:
    """Return the text in Unicode normal form NFC, without surrounding white space.

    Raise ValueError if it holds control characters, or halves of surrogate pairs.
    """
    text = unicodedata.normalize("NFC", text).strip()
    if any(unicodedata.category(character) in {"Cc", "Cs"} for character in text):
        raise ValueError("control characters are not allowed")
    return text


def storable_text(text: str) -> str:
    """Return the text; raise ValueError if no database holds it: with a zero, or half of a surrogate pair."""
    if any(character == "\0" or "\ud800" <= character <= "\udfff" for character in text):
        raise ValueError("text must be Unicode, without zeros and halves of surrogate pairs")
    return text


def clean_id(text: str) -> str:
    """Return an id of a request; an empty one, which nothing has, for text that no database holds."""
    try:
        return storable_text(text)
    except ValueError:
        return ""


def clean_name(name: str) -> str:
    """Return a name of 1 to `NAME_CHARACTERS` characters."""
    name = clean_text(name)
    if not 1 <= len(name) <= NAME_CHARACTERS:
        raise ValueError(f"must have 1 to {NAME_CHARACTERS} characters, not {len(name)}")
    return name


def clean_tags(tags: Iterable[str]) -> list[str]:
    """Return the tags, each once, in the order given.

    Raise ValueError if there are more than `TAGS`, or one is too long, empty, or holds a comma.
    """
    cleaned = list(dict.fromkeys(clean_text(tag) for tag in tags))
    if len(cleaned) > TAGS:
        raise ValueError(f"at most {TAGS} tags are taken, not {len(cleaned)}")
    for tag in cleaned:
        if not 1 <= len(tag) <= TAG_CHARACTERS:
            raise ValueError(f"a tag must have 1 to {TAG_CHARACTERS} characters, not {len(tag)}")
        if "," in tag:
            raise ValueError("a tag cannot hold a comma")
    return cleaned


def clean_metadata(metadata: dict[str, Any]) -> dict[str, Any]:
    """Return an object of JSON values.

    Raise ValueError if it is too large or too deep, or holds a number that is not finite, or text that is not
    Unicode.
    """
    if len(metadata) > METADATA_KEYS:
        raise ValueError(f"at most {METADATA_KEYS} keys are taken, not {len(metadata)}")
    for key in metadata:
        storable_text(key)
        if not 1 <= len(key) <= METADATA_KEY_CHARACTERS:
            raise ValueError(f"a key must have 1 to {METADATA_KEY_CHARACTERS} characters, not {len(key)}")
    for value, depth in _walk(metadata):
        if depth > METADATA_DEPTH:
            raise ValueError(f"nested deeper than {METADATA_DEPTH} levels")
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError("numbers must be finite")
        if isinstance(value, str):
            storable_text(value)
    size = len(json.dumps(metadata, ensure_ascii=False).encode())
    if size > METADATA_BYTES:
        raise ValueError(f"at most {METADATA_BYTES} bytes are taken, not {size}")
    return metadata


def split_tags(values: Iterable[str]) -> list[str]:
    """Return a list of tags, from texts with commas between tags."""
    return [tag for value in values for tag in (part.strip() for part in value.split(",")) if tag]


def listed(value: object) -> object:
    """Return a list of tags or ids, from one text or a list of texts, each with commas between them."""
    if isinstance(value, str):
        return split_tags([value])
    if isinstance(value, list) and all(isinstance(part, str) for part in value):
        return split_tags(value)
    return value


Id = Annotated[str, Field(max_length=64), AfterValidator(clean_id)]
"""An id in a request."""

Name = Annotated[
    str,
    AfterValidator(clean_name),
    Field(
        description=f"The name of the shape: 1 to {NAME_CHARACTERS} characters.",
        examples=["horse-gallop.off"],
        json_schema_extra={"minLength": 1, "maxLength": NAME_CHARACTERS},
    ),
]
Tags = Annotated[
    list[str],
    AfterValidator(clean_tags),
    Field(
        description=f"Up to {TAGS} tags of 1 to {TAG_CHARACTERS} characters, without commas. "
        "A repeated tag counts once.",
        examples=[["horse", "animal"]],
    ),
]
ListedTags = Annotated[Tags, BeforeValidator(listed)]
Metadata = Annotated[
    dict[str, JsonValue],
    AfterValidator(clean_metadata),
    Field(
        description=f"Any JSON object of up to {METADATA_KEYS} keys, {METADATA_DEPTH} levels and "
        f"{METADATA_BYTES} bytes.",
        examples=[{"source": "scan", "year": 2024}],
    ),
]


def plain_values(metadata: dict[str, Any]) -> dict[str, str]:
    """Return the values that filters see, as text: strings unchanged, numbers, booleans and null as JSON."""
    return {
        key: value if isinstance(value, str) else json.dumps(value)
        for key, value in metadata.items()
        if value is None or isinstance(value, str | int | float | bool)
    }


def base_name(filename: str) -> str:
    """Return the last part of a path, with the separators of any system."""
    return filename.replace("\\", "/").rsplit("/", 1)[-1]


def _walk(value: object) -> Iterator[tuple[object, int]]:
    """Yield every value and key of a JSON value, with its depth; an explicit stack replaces recursion."""
    waiting: list[tuple[object, int]] = [(value, 0)]
    while waiting:
        inner, depth = waiting.pop()
        yield inner, depth
        if isinstance(inner, dict):
            waiting += [(part, depth + 1) for pair in inner.items() for part in pair]
        elif isinstance(inner, list):
            waiting += [(part, depth + 1) for part in inner]
