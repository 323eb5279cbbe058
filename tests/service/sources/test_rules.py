"""Patterns of paths: they select what pathspec selects, in a time that no path can stretch."""

import random
import time

import pytest
from pathspec import GitIgnoreSpec

from service.sources.rules import spec_of


def test_patterns_select_what_pathspec_selects() -> None:
    draw = random.Random(0)

    def text(letters: list[str], most: int) -> str:
        return "".join(draw.choices(letters, k=draw.randint(1, most)))

    selected = 0
    for _ in range(300):
        patterns = [text(["a", "b", "*", "*", "?", "/", "/**/", "**", "[ab]"], 6) for _ in range(2)]
        patterns[1] = draw.choice(["", "!"]) + patterns[1]
        mine, theirs = spec_of(patterns), GitIgnoreSpec.from_lines(patterns)
        for _ in range(20):
            path = text(["a", "b", "ab", "/"], 12).replace("//", "/").lstrip("/") or "a"
            assert mine.match_file(path) == theirs.match_file(path), (patterns, path)
            selected += mine.match_file(path)
    assert 1_000 < selected < 5_000


@pytest.mark.parametrize(
    ("pattern", "path"),
    [
        ("*a*a*a*a*a*b", "a" * 2_000),
        ("**/a/**/a/**/a/**/b", "a/" * 900 + "x"),
        ("a/**/*a*/**/*a*/**/b*b", "aa/" * 600 + "x"),
        ("*?*?*?*?*?b/**/c", "a" * 1_000 + "/" + "a" * 1_000),
    ],
)
def test_a_hostile_path_is_matched_at_once(pattern: str, path: str) -> None:
    spec, start = spec_of([pattern]), time.process_time()
    assert not spec.match_file(path)
    assert time.process_time() - start < 0.1
