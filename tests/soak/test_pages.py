"""What stands between two comments of a page is replaced, and nothing else."""

from pathlib import Path

import pytest

from tests.soak.pages import put

PAGE = """# One
<!-- a -->
old
<!-- /a -->
between
<!-- b -->
<!-- /b -->
after
"""


def test_a_section_is_replaced_and_again(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    put(page, "b", "new b")
    put(page, "a", "older a")
    put(page, "a", "\nnew a\n")
    expected = PAGE.replace("\nold\n", "\n\nnew a\n\n").replace("<!-- b -->\n", "<!-- b -->\n\nnew b\n\n")
    assert page.read_text() == expected


@pytest.mark.parametrize(
    "spoilt",
    [
        PAGE.replace("<!-- a -->\n", ""),
        PAGE.replace("<!-- /a -->\n", ""),
        PAGE.replace("<!-- a -->", "<!-- /a -->", 1).replace("old\n<!-- /a -->", "old\n<!-- a -->"),
        PAGE + PAGE,
    ],
)
def test_a_page_without_the_place_is_left_as_it_is(tmp_path: Path, spoilt: str) -> None:
    page = tmp_path / "page.md"
    page.write_text(spoilt)
    with pytest.raises(ValueError, match="no one place for a"):
        put(page, "a", "new")
    assert page.read_text() == spoilt
