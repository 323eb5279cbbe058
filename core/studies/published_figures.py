"""Figures that the paper reports: Tables 1 and 2, and the mean over all categories (section 5)."""

from dataclasses import dataclass
from types import MappingProxyType

METHODS = ("ours", "MDS", "ICP", "Parts", "TPS-RPM")
"""The columns of Table 2."""

ALL_CATEGORIES = 88.5
"""Average recognition accuracy of all models, in 16 categories, in per cent."""


@dataclass(frozen=True)
class Category:
    """A row of Table 2.

    Attributes
    ----------
    title : str
        As it is printed.
    label : str
        The class of the Princeton Segmentation Benchmark, in lower case.
    accuracy : mapping of str to float
        Average classification accuracy by method, in per cent.
    """

    title: str
    label: str
    accuracy: MappingProxyType[str, float]


def _category(title: str, label: str, *accuracy: float) -> Category:
    return Category(title, label, MappingProxyType(dict(zip(METHODS, accuracy, strict=True))))


TABLE_2 = (
    _category("Humans", "human", 86.75, 83.69, 84.69, 86.45, 86.51),
    _category("Four-legged animals", "fourleg", 89.94, 83.75, 89.74, 84.32, 89.86),
    _category("Airplanes", "airplane", 88.67, 83.27, 86.52, 88.41, 88.36),
    _category("Birds", "bird", 81.58, 80.28, 81.69, 82.63, 80.92),
    _category("Fishes", "fish", 72.32, 71.57, 70.86, 70.96, 72.24),
    _category("Cups", "cup", 66.87, 67.38, 65.41, 60.24, 66.97),
)


@dataclass(frozen=True)
class Times:
    """A row of Table 1.

    Attributes
    ----------
    title : str
        As it is printed.
    label : str
        The nearest class of the Princeton Segmentation Benchmark, in lower case.
    points : int
        Vertices of the models.
    sampling, embedding, matching : float
        Seconds: sampling; minimum spanning tree and spectral embedding; sparse spectral matching.
    """

    title: str
    label: str
    points: int
    sampling: float
    embedding: float
    matching: float


TABLE_1 = (
    Times("Humans", "human", 3206, 17.25, 6.63, 12.6),
    Times("Cat", "fourleg", 1730, 10.21, 3.08, 6.4),
    Times("Planes", "airplane", 1038, 5.74, 2.01, 5.02),
    Times("Fishes", "fish", 563, 1.98, 1.22, 2.26),
    Times("Horses", "fourleg", 69451, 25.24, 17.94, 68.47),
    Times("Tiger", "fourleg", 2834, 15.31, 12.64, 20.05),
    Times("Camel", "fourleg", 2830, 14.46, 12.45, 19.39),
    Times("Wolf", "fourleg", 1243, 12.58, 4.37, 8.46),
    Times("Cow", "fourleg", 2903, 16.31, 12.96, 20.21),
)
