"""The evidence as a page in Markdown."""

from collections.abc import Sequence
from textwrap import fill

from core.studies.sampling.robustness import DELTAS, REGIONS, ROBUST_TAU
from core.studies.sampling.surface import STUDY_PARAMETERS
from core.studies.sampling.trials import COMPARED_TAU
from service.studies.sampling.tables import TextTable

_TERMS = (
    "Every mesh is processed as in the default setting: cleaned, put in its normal frame, and its long "
    f"edges split as for {STUDY_PARAMETERS.mesh.refine_vertices:,} even vertices. A mesh of more than "
    f"{STUDY_PARAMETERS.mesh.decimate_above:,} vertices is simplified to "
    f"{STUDY_PARAMETERS.mesh.decimate_to:,}, since the study computes the distances between all pairs.",
    "Lengths are in units of the shape's **scale**, its root mean square radius. **Geodesic** distances "
    "run along edges and across pairs of neighbouring faces.",
    "**cut**: the paper's selection, the tau n vertices of largest weight q. **draw**: a seeded draw of "
    "as many vertices, with probabilities min(1, c q). **weighted farthest point**: farthest-point sampling "
    "with distances multiplied by "
    f"(q / mean q)^{STUDY_PARAMETERS.sampling.coverage_power}, as in the default setting.",
    "**printed**: r1 and r2 of Eqs. 11 and 12 as in the paper, with which q follows the residual alone. "
    "**normalised**: each of the two terms is divided by its sum, so that leverage and residual both count.",
    "**Poisson disk**: dart throwing on the vertices, with the radius that gives the same number "
    "of samples. **farthest point**: each next sample is the vertex farthest from all earlier samples. The "
    "salient geometric (SGS) and MLS methods of Fig. 3b are not reproduced.",
    "**Histogram**: the distances of all pairs of samples over the largest distance, in five ranges of "
    "equal width, per cent. Its **change** is the total variation distance, 0 for equal and 1 for "
    "disjoint. *between taus*: the largest change between two of the three. *from surface*: the mean "
    "change from the histogram of all vertices.",
    "*largest gap*, *mean gap*: distance from a vertex to the nearest sample. *evenness*: the smallest "
    "distance between two samples over the mean distance from a sample to the next.",
    "*fit / best*: f(x, y) is fitted to the samples alone; the RMS residual at all vertices is divided by "
    "the residual of the best fit; the median over the shapes. Rows of a draw have weight 1 / p, as in "
    "Algorithm 1.",
    "*rebuilt*: the samples keep their positions, and all other vertices are stretched between them like a "
    "soap film (each coordinate is harmonic). *as Poisson disk with*: the number of samples with which "
    f"Poisson disk reaches the same error, over the number at tau {COMPARED_TAU}; the paper claims more than "
    "1 for its own method.",
    "**Noise**: Gaussian, on each coordinate of each vertex of the cleaned mesh, before all other steps. "
    "Its standard deviation is a share of the shape's size, the diagonal of its bounding box along the axes "
    f"of the normal frame: the reading of the paper's delta, {DELTAS[0]}. *kept*: the share of the samples "
    f"that stay in their region, with the surface cut into {REGIONS} regions. *kept if even*: the same for "
    "evenly spread samples in place of the noisy ones; only a share above this value shows that preferred "
    "places are kept.",
    f"**Poses**: other poses of one body, each with a mesh of its own, at tau {ROBUST_TAU}, beside the "
    "change between all pairs of the shapes of Fig. 2.",
    "Numbers are means over the shapes unless stated otherwise.",
)

_PICTURES = {"Fig. 2": "fit", "Fig. 3a": "ratio", "Fig. 3b": "methods", "Fig. 3c": "noise"}


def page(tables: Sequence[TextTable], *, source: str, drawn: str, poses: Sequence[str]) -> str:
    """The whole page.

    Parameters
    ----------
    tables : sequence of TextTable
        Titled "Fig. 2: ..." and so on, in the order of the figures.
    source : str
        What was sampled, and the command, as a sentence.
    drawn : str
        The shape in the pictures.
    poses : sequence of str
        Names of the poses; their picture is shown where there are any.
    """
    parts = [
        "# Samples by Lewis weights: Figs. 2 and 3 of the paper, measured again",
        source,
        f"The shape in the pictures is {_plain(drawn)}, seen along z; samples on the far side are not drawn.",
        "## Terms",
        "\n".join(fill(term, 110, initial_indent="- ", subsequent_indent="  ") for term in _TERMS),
    ]
    figure = ""
    for table in tables:
        name, _, title = table.title.partition(": ")
        if name != figure:
            figure = name
            parts += [f"## {name}", f"![{name}](sampling-{_PICTURES[name]}.png)"]
        parts += [f"{title[0].upper()}{title[1:]}.", _markdown(table), table.shows]
    if poses:
        names = ", ".join(map(_plain, poses))
        parts += [f"Samples on the first of the poses ({names}):", "![Fig. 3c, poses](sampling-poses.png)"]
    return "\n\n".join(parts) + "\n"


def _markdown(table: TextTable) -> str:
    rules = ["---"] + ["---:"] * (len(table.columns) - 1)
    rows = [table.columns, rules, *table.rows]
    return "\n".join("| " + " | ".join(map(_plain, row)) + " |" for row in rows)


def _plain(text: str) -> str:
    """Text that Markdown shows as it is: file names may hold anything."""
    if text.strip("-:") == "":
        return text
    safe = text.replace("&", "&amp;").replace("<", "&lt;")
    return "".join("\\" + letter if letter in "\\`*_[]|" else letter for letter in safe.replace("\n", " "))
