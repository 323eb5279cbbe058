"""The figures as a page in Markdown."""

from core.evaluation.classification import Classification
from core.evaluation.retrieval_measures import Evaluation


def page(label: str, figures: Evaluation, found: Classification, *, made: bool) -> str:
    """The text of figures.md, beside the pictures that it shows.

    Parameters
    ----------
    label : str
        The class of the shapes drawn singly.
    figures : Evaluation
        By CC.
    found : Classification
        By CC.
    made : bool
        Whether the shapes are the gallery's.
    """
    right, wrong = (int((found.matched & (found.right == good)).sum()) for good in (True, False))
    unmatched = int((~found.matched).sum())
    source = (
        f"Written by `isoshape figures --out docs`: {figures.shapes} generated shapes of the gallery, in "
        f"{len(figures.classes)} classes. The same command draws the same pictures."
        if made
        else f"Written by `isoshape figures`, of {figures.shapes} shapes in {len(figures.classes)} classes."
    )
    pair = f"one {label} in two poses" if made else f"two shapes of class {label}"
    sections = [
        ("samples", "Fig. 3: samples at three sparse ratios", "Selected as in the default setting."),
        (
            "eigenmap",
            "Fig. 5: the spectral eigenmap",
            "The samples of one shape, coloured by rank along each of the first three coordinates, and "
            "the samples in the spectral domain with the minimum spanning tree.",
        ),
        (
            "match",
            f"Fig. 6: {pair}, matched",
            "Above: matched samples have the same colour; the two clouds (discs and triangles) before any "
            "map. Below: the correspondence extended to all vertices; the clouds after the orthogonal map, "
            "with pairs joined.",
        ),
        (
            "top",
            "Table 3: the three shapes most similar to one query of each class",
            "By CC, the query itself left out; shapes of another class are red.",
        ),
        (
            "confusion",
            "First neighbours by class",
            f"By CC, each shape a query against all other shapes: NN is {figures.nn:.3f}.",
        ),
        (
            "classes",
            "Fig. 10: the collection classified",
            f"Each shape has the class of its first neighbour by CC ({right} right, {wrong} wrong), or is "
            f"unmatched, in grey ({unmatched}), when its CC is under the threshold, {found.threshold:.4f}, "
            "that best separates shapes whose class is present from shapes whose class is left out (balanced "
            f"accuracy {found.balanced_accuracy:.3f}; each class is judged by the threshold of the others).",
        ),
    ]
    text = ["# The paper's figures", source]
    for name, title, caption in sections:
        text += [f"## {title}", f"![{title}](figures-{name}.png)", caption]
    return "\n\n".join(text) + "\n"
