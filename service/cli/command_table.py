"""The commands of `isoshape`: the group, the module and the summary of each.

The summary is the first line of the docstring of the module's function `command`. It stands here too, so that
`isoshape --help` imports no command.
"""

from dataclasses import dataclass
from typing import Literal

Group = Literal["Use", "Archive", "Research"]

LONGEST_SUMMARY = 60
"""Characters of a summary at most: it then fits on one line of a terminal of 80 columns."""


@dataclass(frozen=True)
class Command:
    """A command: the group it is listed in, and one line on what it does."""

    group: Group
    summary: str
    package: str = "service.cli"


def _study(summary: str) -> Command:
    return Command("Research", summary, "service.cli.studies")


COMMANDS = {
    "serve": Command("Use", "Serve the archive over HTTP until Ctrl-C."),
    "demo": Command("Use", "Make shapes, store them and query them with unseen poses."),
    "ingest": Command("Use", "Store mesh files, folders of meshes and archives."),
    "query": Command("Use", "Find the stored shapes most similar to a mesh file."),
    "compare": Command("Use", "Compare two shapes, vertex by vertex with --out."),
    "duplicates": Command("Use", "Find groups of near-identical stored shapes."),
    "collections": Command("Use", "List, create and delete collections of shapes."),
    "compile": Command("Use", "Compile the kernels for this processor, once."),
    "key": Command("Use", "Make an API key and print it with its SHA-256."),
    "openapi": Command("Use", "Write the OpenAPI document of the service."),
    "check": Command("Archive", "Check every file, reference and embedding of an archive."),
    "backup": Command("Archive", "Copy the archive into a file while services use it."),
    "restore": Command("Archive", "Replace the archive by a backup."),
    "copy": Command("Archive", "Copy an archive between SQLite and PostgreSQL."),
    "reembed": Command("Archive", "Embed every stored shape by another pipeline."),
    "evaluate": _study("Measure retrieval on a labelled collection."),
    "classify": _study("Classify each shape by its nearest neighbour."),
    "robustness": _study("Measure retrieval of perturbed queries (Fig. 9)."),
    "ablation": _study("Measure retrieval after each change to the paper's setting."),
    "table2": _study("Measure the paper's Table 2, category by category."),
    "figures": _study("Draw the paper's figures of spectra, matches and classes."),
    "sampling": _study("Measure how vertices are sampled (Figs. 2 and 3)."),
    "correspondence": _study("Measure correspondences against the true ones."),
    "calibrate": _study("Fit the class probability to labelled collections."),
    "benchmark": _study("Measure the time and memory of embedding and matching."),
}
"""Each command by its name, which is also the name of its module, in the order of the help."""
