"""The tools that `isoshape mcp` offers, and their server."""

from pathlib import Path
from typing import Any

from mcp.server.fastmcp import FastMCP, Image
from mcp.types import ToolAnnotations

from core.io import format_of
from service.client import Client
from service.duplicates.records import Decision
from service.search.schemas import RankBy, Result, likeness_in_words
from service.shapes.schemas import Shape, box_in_words, in_unit

INSTRUCTIONS = (
    "Isoshape stores 3D meshes, and finds those most similar to a given one in any pose. Shapes have ids. "
    "Likenesses are same, scaled, mirrored, variant, pose, similar and weak, from the greatest to none."
)

Written = dict[str, Any]
"""The answer of a tool."""


def server_of(client: Client, *, write: bool) -> FastMCP[Any]:
    """Return a server with the tools that read or, with `write`, with all tools."""
    tools = Tools(client)
    server: FastMCP[Any] = FastMCP("isoshape", INSTRUCTIONS, log_level="ERROR")
    reading = (tools.search_shapes, tools.find_similar, tools.find_similar_to_file, tools.compare)
    for tool in (*reading, tools.duplicates, tools.facets, tools.picture):
        server.tool(annotations=ToolAnnotations(readOnlyHint=True))(tool)
    if write:
        for change in (tools.change_tags, tools.decide_duplicates):
            server.tool(annotations=ToolAnnotations(readOnlyHint=False, destructiveHint=False))(change)
    return server


class Tools:
    """The tools, on a client of a service. A program reads their docstrings and parameters."""

    def __init__(self, client: Client) -> None:
        self._client = client

    def search_shapes(self, words: str = "", tags: list[str] | None = None, limit: int = 10) -> Written:
        """List stored shapes that have all words in name, tags, metadata or paths, the best match first."""
        page = self._client.page(q=words or None, tag=tags or [], limit=limit)
        return {"shapes": [_shape(shape) for shape in page.shapes], "total": page.total}

    def find_similar(
        self, shape_id: str, top_k: int = 5, rank_by: RankBy = "combined", words: str = ""
    ) -> Written:
        """Find the stored shapes most similar to a stored shape, among those that have all words."""
        answer = self._client.query_shape(shape_id, top_k=top_k, rank_by=rank_by, q=words or None)
        return {"results": [_result(result) for result in answer.results], "compared": answer.compared}

    def find_similar_to_file(
        self, path: str, top_k: int = 5, rank_by: RankBy = "combined", words: str = ""
    ) -> Written:
        """Find the stored shapes most similar to a mesh file on this machine, such as an STL."""
        file = Path(path).expanduser()
        # No other file is read.
        format_of(file.name)
        mesh = (file.name, file.read_bytes())
        answer = self._client.query_file(mesh, top_k=top_k, rank_by=rank_by, q=words or None)
        return {"results": [_result(result) for result in answer.results], "warnings": answer.warnings}

    def compare(self, first: str, second: str) -> Written:
        """Tell in what two stored shapes, given by their ids, are alike, and where they differ."""
        scores = self._client.compare(first, second)
        return {
            "likeness": likeness_in_words(scores.likeness, scores.scale, scores.difference),
            "probability_of_one_class": scores.combined,
            "cc": scores.cc,
            "sim": scores.sim,
        }

    def duplicates(
        self, words: str = "", scaled: bool = False, variants: bool = False, limit: int = 20
    ) -> Written:
        """Find groups of near-identical shapes, with `scaled` of any size, with `variants` variants too."""
        answer = self._client.duplicates(q=words or None, scaled=scaled, variants=variants, limit=limit)
        groups = [
            [{**_shape(each.shape), "likeness": each.likeness} for each in group] for group in answer.groups
        ]
        return {"groups": groups, "total": answer.total, "unjudged": answer.unjudged}

    def facets(self, words: str = "") -> Written:
        """Count the shapes that have all words, by tag, format, longest side and collection."""
        return self._client.facets(q=words or None).model_dump(mode="json")

    def picture(self, shape_id: str) -> Image:
        """Show a picture of a stored shape."""
        return Image(data=self._client.thumbnail(shape_id, size=512), format="png")

    def change_tags(
        self, shape_id: str, add: list[str] | None = None, remove: list[str] | None = None
    ) -> Written:
        """Add tags to a stored shape, and remove tags."""
        kept = [tag for tag in self._client.shape(shape_id).tags if tag not in (remove or [])]
        return _shape(self._client.update(shape_id, tags=list(dict.fromkeys([*kept, *(add or [])]))))

    def decide_duplicates(self, shape_ids: list[str], decision: Decision, reason: str = "") -> Written:
        """Decide what near-identical shapes are to each other, so that they are not shown again."""
        return self._client.decide(shape_ids, decision, reason=reason).model_dump(mode="json")


def _shape(shape: Shape) -> Written:
    return {
        "id": shape.id,
        "name": shape.name,
        "tags": shape.tags,
        "metadata": shape.metadata,
        "sides": in_unit(box_in_words(shape.facts), shape.unit),
    }


def _result(result: Result) -> Written:
    return {
        **_shape(result.shape),
        "likeness": likeness_in_words(result.likeness, result.scale, result.difference),
        "probability_of_one_class": result.combined,
        "cc": result.cc,
    }
