"""`isoshape key`: a new key."""

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
    """Make a key, and print it and its SHA-256.

    The service is given the digest, in ISOSHAPE_API_KEYS (may do everything) or ISOSHAPE_READ_KEYS (may read,
    query and compare); of a key that is limited to collections, with their names behind it, as printed.
    Whoever uses the service is given the key. It is kept nowhere.
    """
    for name in collection or []:
        if not is_name(name):
            fail(f"no collection can be called {name!r}", status=2)
    key = new_key()
    entry = KeyEntry(digest_of(key), frozenset(collection) if collection else None)
    console = output()
    console.print(f"key     {key}", soft_wrap=True)
    console.print(f"sha256  {entry.write()}", soft_wrap=True)
