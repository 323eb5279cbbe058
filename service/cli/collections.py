"""`isoshape collections`: the named sets of shapes."""

from typing import Annotated

import typer
from rich import box
from rich.table import Table

from service.cli.service_address import Key, Url, service_at
from service.console import output


def command(
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
        found = client.collections().collections
    table = Table(box=box.SIMPLE_HEAD, collapse_padding=True)
    table.add_column("collection", no_wrap=True)
    table.add_column("shapes", justify="right")
    for one in found:
        table.add_row(one.name, str(one.shapes))
    output().print(table)
