"""Retrieval of perturbed queries as a page in Markdown."""

from textwrap import fill

from core.mesh.simplification import MOST_WORK, SHORT
from core.studies.perturbation import DISCS, LARGE_FACE, PARTS, SPLIT_TO
from core.studies.robustness import TAU_CAP, TAU_VERTICES, RobustnessStudy
from service.studies.robustness.figures import SHOWN
from service.studies.robustness.table import table

_TERMS = (
    "Each shape in turn is cleaned, perturbed and used as the query; the gallery is all other shapes, "
    "unperturbed, without the query's own clean self. **NN**: the share of queries whose first result has "
    "their class. A query that cannot be embedded (*unusable*: the largest number of any seed) counts as "
    "answered wrongly. **own CC**: the mean CC of a perturbed shape with its own clean self.",
    "Random choices follow the seed, separately for each shape. Perturbations without random choices (all "
    "edges split, faces not shrunk, tau) are run once.",
    "**NN as a part**: the query with `partial=true`, which is for incomplete shapes.",
    "**Gaussian noise**: isotropic, on every vertex; the deviation of each coordinate as a share of the "
    "bounding box's diagonal. Neighbouring vertices move independently, so a finer mesh becomes rougher.",
    f"**holes**: {DISCS} geodesic discs of one radius are removed, their centres drawn in proportion to "
    "area. **a part cut away**: the surface on one side of a plane with a random direction is removed. Whole "
    "faces are removed, so the removed area is exact to half a face. A mesh with a face of more than "
    f"{100 * LARGE_FACE:g} % of the area is first subdivided as for {SPLIT_TO:,} even vertices.",
    "**decimation**: by quadric error, with the faces in random order. Vertices are clustered on a grid "
    f"instead where the squared valences of the vertices sum to more than {MOST_WORK:,.0f} (fans of "
    f"thousands of faces, on which decimation is very slow), or where decimation stops at more than "
    f"{SHORT:g} times the target number of faces.",
    "**subdivision**: midpoints on randomly chosen edges; at 100 % every face is cut into four.",
    "**triangle soup**: every face has vertices of its own. At 0 % the vertices still coincide; otherwise "
    "each face shrinks towards its centroid, on average by that share of its size.",
    f"**loose parts**: the surface in {PARTS} parts, each moved in its own direction by that share of the "
    "diagonal.",
    "**tau**: the default setting's fixed number of samples is replaced by the paper's sparse ratio, for "
    "gallery and queries. To keep tau 0.8 feasible, meshes are first refined or simplified to about "
    f"{TAU_VERTICES} vertices, and no mesh has more than {TAU_CAP} samples; the fall is against the default "
    "setting.",
)


def page(study: RobustnessStudy, command: str) -> str:
    """The whole page; `command` is the command that made it."""
    found = table(study)
    rules = ["---", *["---:"] * (len(found.columns) - 1)]
    lines = ["| " + " | ".join(row) + " |" for row in (found.columns, rules, *found.rows)]
    parts = [
        "# Robustness: perturbed queries against a clean gallery",
        f"The paper's Fig. 9, measured again. Written by `{command}`: {study.shapes} shapes of "
        f"{study.classes} classes, {study.seeds} seed(s), setting `default`. The same command gives the same "
        "numbers.",
        "![NN by amount of each perturbation](robustness.png)",
        "Bars span the seeds; dotted lines are the clean queries. " + found.shows,
        "\n".join(lines),
        "## Terms",
        "\n".join(fill(term, 110, initial_indent="- ", subsequent_indent="  ") for term in _TERMS),
        f"A generated {SHOWN} under the strongest amount of each perturbation:",
        "![The perturbations](robustness-shapes.png)",
    ]
    return "\n\n".join(parts) + "\n"
