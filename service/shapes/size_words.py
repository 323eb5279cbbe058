"""Sizes of shapes as text, in the units of their files."""

from service.shapes.schemas import MeshFacts


def number_in_words(value: float) -> str:
    """A number with four digits, and without an exponent below a million."""
    return f"{float(f'{value:.4g}'):g}"


def box_in_words(facts: MeshFacts) -> str:
    """Length, width and height: "100 × 20 × 10"."""
    return " × ".join(map(number_in_words, facts.bounding_box))


def volume_in_words(facts: MeshFacts) -> str:
    """The volume, or that the surface is open and has none."""
    return number_in_words(facts.volume) if facts.closed else "open surface"
