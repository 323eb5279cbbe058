"""Pages and docstrings: links and files exist, pages stay short, functions begin with verbs."""

import ast
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

PATH = re.compile(r"`((?:core|service|tests|docker|docs|openapi)/[\w./-]+)`")
SCRIPT = re.compile(r"python -m (tests(?:\.\w+)+)")
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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_a_page_names_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    scripts = [name.replace(".", "/") for name in SCRIPT.findall(text)]
    named = [*PATH.findall(text), *(name if (ROOT / name).is_dir() else f"{name}.py" for name in scripts)]
    assert [path for path in named if "NAME" not in path and not (ROOT / path).exists()] == []


def test_the_tree_has_every_folder() -> None:
    tree = (DOCS / "architecture.md").read_text(encoding="utf-8")
    folders = {
        path.parent.relative_to(ROOT) for top in ("core", "service") for path in (ROOT / top).rglob("*.py")
    }
    named = set(re.findall(r"^ +(\w+)/ ", tree, re.MULTILINE))
    assert {folder.parts[1] for folder in folders if len(folder.parts) > 1} == named - {
        *("core", "service", "tests", "kernels", "soak", "studies", "docker")
    }


def test_every_page_and_picture_is_linked() -> None:
    targets = {(page.parent / target.partition("#")[0]).resolve() for page in PAGES for target in links(page)}
    files = {path.resolve() for path in chain(DOCS.glob("*.md"), DOCS.glob("*.png"))}
    assert files - targets == {DOCS / "README.md"} - targets


def test_the_readme_has_one_page() -> None:
    assert (ROOT / "README.md").stat().st_size <= 8_000


def test_the_pages_can_be_read_in_an_afternoon() -> None:
    pages = [ROOT / "README.md", *DOCS.glob("*.md")]
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in pages) <= 25_000


NOUNS = {"The", "A", "An", "Whether", "Of", "What", "That", "Those"}


def functions(path: Path) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Return the functions of a module, but for properties."""
    return [
        node
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and not any("property" in ast.unparse(decorator) for decorator in node.decorator_list)
    ]


@pytest.mark.parametrize("package", ["core", "service"])
def test_the_docstring_of_a_function_begins_with_a_verb(package: str) -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{function.lineno} {function.name}"
        for path in sorted((ROOT / package).rglob("*.py"))
        for function in functions(path)
        if (ast.get_docstring(function) or "Return").split()[0].rstrip(",.:") in NOUNS
    ]
    assert wrong == []
