"""`isoshape mcp`: the archive as tools of the Model Context Protocol, over standard input and output."""

from importlib.util import find_spec
from typing import Annotated

import typer

from service.cli.service_address import Collection, Key, Url, service_at
from service.console import fail


def mcp_command(
    *,
    write: Annotated[
        bool, typer.Option("--write", help="Also offer tools that change tags and decide duplicates.")
    ] = False,
    url: Url = None,
    key: Key = None,
    collection: Collection = None,
) -> None:
    """Offer the archive to programs over MCP.

    A program that speaks the Model Context Protocol starts this command, and talks with it over standard
    input and output. The tools only read unless --write is given.
    """
    if find_spec("mcp") is None:
        fail("this needs a package: pip install 'isoshape[mcp]'")
    # Here, because the package of the protocol belongs to an extra.
    from service.cli.mcp_tools import server_of  # noqa: PLC0415

    with service_at(url, key, collection) as client:
        server_of(client, write=write).run()
