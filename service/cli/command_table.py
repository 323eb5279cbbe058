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
    "evaluate": Command("Research", "Measure retrieval on a labelled collection.", "studies.evaluate"),
    "classify": Command("Research", "Classify each shape by its nearest neighbour.", "studies.classify"),
    "robustness": Command(
        "Research", "Measure retrieval of perturbed queries (Fig. 9).", "studies.robustness"
    ),
    "ablation": Command(
        "Research", "Measure retrieval after each change to the paper's setting.", "studies.ablation"
    ),
    "table2": Command("Research", "Measure the paper's Table 2, category by category.", "studies.table2"),
    "figures": Command(
        "Research", "Draw the paper's figures of spectra, matches and classes.", "studies.figures"
    ),
    "sampling": Command("Research", "Measure how vertices are sampled (Figs. 2 and 3).", "studies.sampling"),
    "correspondence": Command(
        "Research", "Measure correspondences against the true ones.", "studies.correspondence"
    ),
    "calibrate": Command(
        "Research", "Fit the class probability to labelled collections.", "studies.calibrate"
    ),
    "benchmark": Command(
        "Research", "Measure the time and memory of embedding and matching.", "studies.benchmark"
    ),
}
"""Each command by its name, in the order of the help."""
