"""Likenesses in words for people, as the page, the command line and the report show them."""

from core.ranking.likeness import Likeness

WORDS: dict[Likeness, str] = {
    "same": "Same part",
    "scaled": "Same part",
    "mirrored": "Mirror image",
    "variant": "Variant",
    "pose": "Another pose",
    "similar": "Similar",
    "weak": "Weak",
}


def in_words(likeness: Likeness, scale: float | None) -> str:
    """A likeness in words: "Same part, 1.5 times as large".

    Parameters
    ----------
    likeness : Likeness
    scale : float or None
        Length in the second shape over length in the first; it is told where the sizes differ.
    """
    if likeness != "scaled" or scale is None:
        return WORDS[likeness]
    # Three digits; the second format writes 1000 without an exponent.
    return f"{WORDS[likeness]}, {float(f'{scale:.3g}'):g} times as large"
