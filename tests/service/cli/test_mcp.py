"""The tools of `isoshape mcp`, used by the protocol's own client over standard input and output."""

import asyncio
import base64
import io
import json
import sys
from collections.abc import Awaitable, Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

from mcp import ClientSession, StdioServerParameters
from mcp.client.stdio import stdio_client
from mcp.types import ImageContent, TextContent
from PIL import Image

from tests.service.support import Running, small_file

Use = Callable[[ClientSession], Awaitable[None]]


def used(service: Running, use: Use, *options: str) -> None:
    """Start the command on a service, and use its tools."""

    async def session() -> None:
        arguments = ["-m", "service.cli", "mcp", "--url", str(service.client.base_url), *options]
        async with (
            stdio_client(StdioServerParameters(command=sys.executable, args=arguments)) as (received, sent),
            ClientSession(received, sent, timedelta(seconds=120)) as client,
        ):
            await client.initialize()
            await use(client)

    asyncio.run(session())


async def answer(client: ClientSession, tool: str, **arguments: Any) -> Any:
    result = await client.call_tool(tool, arguments)
    (content,) = result.content
    assert isinstance(content, TextContent)
    assert not result.isError, content.text
    return json.loads(content.text)


def test_a_program_finds_compares_and_decides(service: Running, tmp_path: Path) -> None:
    cup, copy, lamp = (
        service.store(data, name)["id"]
        for name, data in {
            "cup.off": small_file(0),
            "cup again.off": small_file(0) + b"# again\n",
            "lamp.off": small_file(3),
        }.items()
    )
    path = tmp_path / "query.off"
    path.write_bytes(small_file(3))

    async def use(client: ClientSession) -> None:
        tools = (await client.list_tools()).tools
        reading = {tool.name for tool in tools if tool.annotations and tool.annotations.readOnlyHint}
        assert {tool.name for tool in tools} - reading == {"change_tags", "decide_duplicates"}
        assert all(tool.description for tool in tools)
        found = await answer(client, "search_shapes", words="cup")
        assert {shape["id"] for shape in found["shapes"]} == {cup, copy}
        similar = await answer(client, "find_similar", shape_id=cup, top_k=1)
        assert (similar["results"][0]["id"], similar["results"][0]["likeness"]) == (copy, "Same part")
        of_file = await answer(client, "find_similar_to_file", path=str(path), top_k=1)
        assert of_file["results"][0]["id"] == lamp
        assert (await answer(client, "compare", first=cup, second=copy))["likeness"] == "Same part"
        assert (await answer(client, "facets", words="cup"))["total"] == 2
        groups = (await answer(client, "duplicates"))["groups"]
        assert [[shape["id"] for shape in group] for group in groups] == [[cup, copy]]
        none = await answer(client, "duplicates", limit=0)
        assert (none["groups"], none["total"]) == ([], 1)
        (picture,) = (await client.call_tool("picture", {"shape_id": cup})).content
        assert isinstance(picture, ImageContent)
        assert Image.open(io.BytesIO(base64.b64decode(picture.data))).size == (512, 512)
        tagged = await answer(client, "change_tags", shape_id=cup, add=["seen", "red"], remove=["seen"])
        assert tagged["tags"] == ["seen", "red"]
        assert (await answer(client, "decide_duplicates", shape_ids=[cup, copy], decision="same"))[
            "pairs"
        ] == 1
        assert (await answer(client, "duplicates"))["groups"] == []
        for tool, wrong in (
            ("find_similar", {"shape_id": "none"}),
            ("find_similar_to_file", {"path": "/etc/passwd"}),
        ):
            assert (await client.call_tool(tool, wrong)).isError

    used(service, use, "--write")
    for decision in service.client.get("/duplicates/decisions").json()["decisions"]:
        service.client.delete(f"/duplicates/decisions/{decision['id']}")


def test_the_tools_only_read_unless_told_otherwise(service: Running) -> None:
    async def use(client: ClientSession) -> None:
        tools = (await client.list_tools()).tools
        assert all(tool.annotations is not None and tool.annotations.readOnlyHint for tool in tools)
        assert (await client.call_tool("change_tags", {"shape_id": "x"})).isError

    used(service, use)
