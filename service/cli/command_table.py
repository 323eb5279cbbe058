"""The commands of `isoshape`: the group, the summary and the module of each.

The command NAME is the function `NAME_command` of its module. The summary is the first line of the function's
docstring. It stands here too, so that `isoshape --help` imports no command.
"""

from dataclasses import dataclass
from typing import Literal

Group = Literal["Use", "Archive", "Research"]

LONGEST_SUMMARY = 60
"""Characters of a summary at most: it then fits on one line of a terminal of 80 columns."""


@dataclass(frozen=True)
class Command:
    """A command: the group that lists it, its summary, and its module in `service.cli`."""

    group: Group
    summary: str
    module: str


def _evaluation(summary: str, module: str) -> Command:
    return Command("Research", summary, f"evaluation.{module}")


COMMANDS = {
    "serve": Command("Use", "Serve the archive over HTTP until Ctrl-C.", "serve"),
    "demo": Command("Use", "Make shapes, store them and query them with unseen poses.", "demo"),
    "ingest": Command("Use", "Store mesh files, folders of meshes and archives.", "ingest"),
    "query": Command("Use", "Find the stored shapes most similar to a mesh file.", "query"),
    "compare": Command("Use", "Compare two shapes, vertex by vertex with --out.", "compare"),
    "duplicates": Command("Use", "Find groups of near-identical stored shapes.", "compare"),
    "collections": Command("Use", "List, create and delete collections of shapes.", "access"),
    "compile": Command("Use", "Compile the kernels for this processor, once.", "serve"),
    "key": Command("Use", "Make an API key and print it with its SHA-256.", "access"),
    "openapi": Command("Use", "Write the OpenAPI document of the service.", "serve"),
    "check": Command("Archive", "Check every file, reference and embedding of an archive.", "archives"),
    "backup": Command("Archive", "Copy the archive into a file while services use it.", "archives"),
    "restore": Command("Archive", "Replace the archive by a backup.", "archives"),
    "copy": Command("Archive", "Copy an archive between SQLite and PostgreSQL.", "archives"),
    "reembed": Command("Archive", "Embed every stored shape by another pipeline.", "archives"),
    "evaluate": _evaluation("Measure retrieval on a labelled collection.", "evaluate"),
    "classify": _evaluation("Classify each shape by its nearest neighbour.", "classify"),
    "table2": _evaluation("Measure the paper's Table 2, category by category.", "table2"),
    "correspondence": _evaluation("Measure correspondences against the true ones.", "correspondence"),
    "calibrate": _evaluation("Fit the class probability to labelled collections.", "calibrate"),
    "benchmark": _evaluation("Measure the time and memory of embedding and matching.", "benchmark"),
}
"""Each command by its name, in the order of the help."""
