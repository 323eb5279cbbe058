"""Likenesses in words: the same in Python and in the scripts of the page."""

import re
from pathlib import Path
from typing import get_args

from core.ranking.likeness import Likeness
from service.search.likeness_words import WORDS, in_words

SCRIPT = Path(__file__).parents[3] / "service" / "web" / "static" / "card.js"


def test_every_likeness_has_words() -> None:
    assert set(WORDS) == set(get_args(Likeness))


def test_the_page_has_the_same_words() -> None:
    found = re.findall(r'^  (\w+): "([^"]+)",$', SCRIPT.read_text(), re.MULTILINE)
    assert dict(found) == WORDS


def test_the_size_is_told_where_it_differs() -> None:
    assert in_words("same", 0.99) == "Same part"
    assert in_words("scaled", 1.5) == "Same part, 1.5 times as large"
    assert in_words("scaled", 25.400001) == "Same part, 25.4 times as large"
    assert in_words("scaled", 1000.0001) == "Same part, 1000 times as large"
    assert in_words("pose", None) == "Another pose"
