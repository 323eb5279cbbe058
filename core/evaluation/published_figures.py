"""Accuracies that the paper reports: Table 2, and the mean over all categories (section 5)."""

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
