"""Likenesses and scores in words; likenesses are the same in Python and in the scripts of the page."""

import re
from pathlib import Path
from typing import get_args

import pytest

from core.ranking.likeness import TOLD_SIZE, Likeness
from service.search.schemas import LIKENESS_WORDS, likeness_in_words, score_in_words

SCRIPT = Path(__file__).parents[3] / "service" / "web" / "static" / "card.js"


def test_every_likeness_has_words() -> None:
    assert set(LIKENESS_WORDS) == set(get_args(Likeness))


def test_the_page_has_the_same_words() -> None:
    found = re.findall(r'^  (\w+): "([^"]+)",$', SCRIPT.read_text(), re.MULTILINE)
    assert dict(found) == LIKENESS_WORDS


def test_the_page_tells_the_same_sizes() -> None:
    assert f"Math.max(scale, 1 / scale) > {1 + TOLD_SIZE};" in SCRIPT.read_text()


def test_the_size_is_told_where_it_differs() -> None:
    assert likeness_in_words("same", 1.001) == likeness_in_words("same", 1 / 1.001) == "Same part"
    assert likeness_in_words("same", 1.0012) == "Same part, 1.001 times as large"
    assert likeness_in_words("same", 1.029) == "Same part, 1.029 times as large"
    assert likeness_in_words("same", 0.99) == "Same part, 0.99 times as large"
    assert likeness_in_words("variant", 1.01) == "Variant, 1.01 times as large"
    assert likeness_in_words("scaled", 1.5) == "Same part, 1.5 times as large"
    assert likeness_in_words("scaled", 25.400001) == "Same part, 25.4 times as large"
    assert likeness_in_words("scaled", 1000.0001) == "Same part, 1000 times as large"
    assert likeness_in_words("pose", None) == "Another pose"


@pytest.mark.parametrize(
    ("score", "text"),
    [
        (0.5, "0.5000"),
        (-0.25, "-0.2500"),
        (0.97123, "0.9712"),
        (0.99612, "0.9961"),
        (0.999612, "0.99961"),
        (0.99998765, "0.999988"),
        (0.9999999, "0.9999999"),
        (0.99999999, "1.0000"),
        (1.0, "1.0000"),
        (1.0 + 1e-12, "1.0000"),
    ],
)
def test_near_one_a_score_has_as_many_digits_as_tell(score: float, text: str) -> None:
    assert score_in_words(score) == text
