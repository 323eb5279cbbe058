"""The pages of the project: their links lead somewhere, their pictures are shown, and they stay short."""

import re
from itertools import chain
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted(DOCS.glob("*.md")),
]

LINK = re.compile(r"\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)


def links(page: Path) -> list[str]:
    """Return the targets of the links and pictures of a page, but for those of other sites."""
    targets = LINK.findall(page.read_text(encoding="utf-8"))
    return [target for target in targets if "://" not in target]


def anchors(page: Path) -> set[str]:
    """Return the anchors of the headings of a page, as GitHub makes them."""
    headings = HEADING.findall(page.read_text(encoding="utf-8"))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_a_file_and_a_heading(page: Path) -> None:
    for target in links(page):
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), target
        if anchor:
            assert anchor in anchors(file), target


def test_every_page_and_picture_is_linked() -> None:
    targets = {(page.parent / target.partition("#")[0]).resolve() for page in PAGES for target in links(page)}
    files = {path.resolve() for path in chain(DOCS.glob("*.md"), DOCS.glob("*.png"))}
    assert files - targets == {DOCS / "README.md"} - targets


def test_the_readme_has_one_page() -> None:
    assert (ROOT / "README.md").stat().st_size <= 8_000


def test_the_pages_can_be_read_in_an_afternoon() -> None:
    pages = [ROOT / "README.md", *DOCS.glob("*.md")]
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in pages) <= 30_000
