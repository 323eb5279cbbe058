"""The commands on keys and collections: `isoshape key` and `isoshape collections`."""

from typing import Annotated

import typer

from service.auth.keys import KeyEntry, digest_of, new_key
from service.cli.service_address import Key, Url, service_at
from service.collection import is_name
from service.console import fail, output, table


def key_command(
    *,
    collection: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Limit the key to this collection; repeatable.")
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


def collections_command(
    *,
    create: Annotated[str | None, typer.Option(metavar="NAME", help="Create this collection first.")] = None,
    delete: Annotated[
        str | None, typer.Option(metavar="NAME", help="Delete this collection first; it must be empty.")
    ] = None,
    url: Url = None,
    key: Key = None,
) -> None:
    """List, create and delete collections of shapes.

    A collection is a named set of shapes. The list has the number of shapes of each.
    """
    with service_at(url, key, new=create is not None) as client:
        if create is not None:
            client.create_collection(create)
        if delete is not None:
            client.delete_collection(delete)
        collections = client.collections().collections
    listed = table("collection", ">shapes")
    for collection in collections:
        listed.add_row(collection.name, str(collection.shapes))
    output().print(listed)
