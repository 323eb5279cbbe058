"""Retrieval of perturbed queries as a page in Markdown."""

from textwrap import fill

from core.mesh.simplification import MOST_WORK, SHORT
from core.studies.perturbation import DISCS, LARGE_FACE, PARTS, SPLIT_TO
from core.studies.robustness import TAU_CAP, TAU_VERTICES, Study
from service.studies.robustness.figures import SHOWN
from service.studies.robustness.table import table

_TERMS = (
    "Each shape in turn is cleaned, perturbed and made the query; the gallery is all other shapes as they "
    "are, so its own clean self is left out. **NN**: the share of queries whose first answer is of their "
    "class. A query that cannot be embedded (*unusable*: the most of any seed) counts as answered wrongly. "
    "**own CC**: the mean CC of a perturbed shape with its own clean self.",
    "A seed settles all chance; each shape's is its own. What leaves nothing to chance (all edges split, "
    "faces drawn in by nothing, tau) is run once.",
    "**NN as a part**: the query with `partial=true`, which is for shapes of which something is missing.",
    "**Gaussian noise**: isotropic, on every vertex; the deviation of each coordinate as a share of the "
    "bounding box's diagonal. Neighbouring vertices move independently, so the finer the mesh, the rougher "
    "its surface becomes.",
    f"**holes**: {DISCS} geodesic discs of one radius are removed, their centres drawn by area. **a part cut "
    "away**: all beyond a plane of a direction drawn evenly. Whole faces go, so the area gone is right to "
    f"within half a face; a mesh with a face of more than {100 * LARGE_FACE:g} % of the area is split first, "
    f"as for {SPLIT_TO:,} even vertices.",
    "**decimation**: by quadric error, in an order of the faces that is drawn. Where the squared valences of "
    f"the vertices add up to more than {MOST_WORK:,.0f} (fans of thousands of faces, on which it takes very "
    f"long), or where it stops at more than {SHORT:g} times the faces wanted, vertices are clustered on a "
    "grid instead.",
    "**subdivision**: midpoints on edges that are drawn; at 100 % every face is cut into four.",
    "**triangle soup**: every face has corners of its own. At 0 % they still coincide; otherwise each face "
    "is drawn in towards its centroid, by that share of its size in the mean.",
    f"**loose parts**: the surface in {PARTS} parts, each moved in a direction of its own by that share of "
    "the diagonal.",
    f"**tau**: gallery and queries are embedded anew with the default setting's fixed number of samples "
    f"replaced by the paper's sparse ratio. To keep tau 0.8 feasible, meshes are refined or simplified to "
    f"about {TAU_VERTICES} vertices first, and there are never more than {TAU_CAP} samples; the fall is "
    "against the default setting.",
)


def page(study: Study, command: str) -> str:
    """The whole page; `command` is what made it."""
    found = table(study)
    rules = ["---", *["---:"] * (len(found.columns) - 1)]
    lines = ["| " + " | ".join(row) + " |" for row in (found.columns, rules, *found.rows)]
    parts = [
        "# Robustness: perturbed queries against a clean gallery",
        f"The paper's Fig. 9, measured again. Written by `{command}`: {study.shapes} shapes of "
        f"{study.classes} classes, {study.seeds} seed(s), setting `default`. The same command gives the same "
        "numbers.",
        "![NN by amount of each perturbation](robustness.png)",
        "Bars reach from the smallest to the largest over the seeds; dotted, the clean queries. "
        + found.shows,
        "\n".join(lines),
        "## What the words mean",
        "\n".join(fill(term, 110, initial_indent="- ", subsequent_indent="  ") for term in _TERMS),
        f"A made {SHOWN} under the strongest amount of each:",
        "![The perturbations](robustness-shapes.png)",
    ]
    return "\n\n".join(parts) + "\n"
