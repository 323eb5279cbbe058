"""`isoshape key`: a new API key."""

from typing import Annotated

import typer

from service.auth.keys import KeyEntry, digest_of, new_key
from service.collection import is_name
from service.console import fail, output


def command(
    *,
    collection: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Limit the key to this collection; repeatable."),
    ] = None,
) -> None:
    """Make an API key and print it with its SHA-256.

    Users of the service send the key; it is stored nowhere. The service knows its SHA-256, from
    ISOSHAPE_API_KEYS (all calls) or ISOSHAPE_READ_KEYS (reading, queries and comparisons). The names of
    collections behind the SHA-256 limit the key to them.
    """
    for name in collection or []:
        if not is_name(name):
            fail(f"no collection can have the name {name!r}", status=2)
    key = new_key()
    entry = KeyEntry(digest_of(key), frozenset(collection) if collection else None)
    console = output()
    console.print(f"key     {key}", soft_wrap=True)
    console.print(f"sha256  {entry.write()}", soft_wrap=True)
