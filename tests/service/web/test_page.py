"""The page as files: what is sent, with what said of it, and that it is whole and small."""

import re
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest

from service.shapes.endpoints import PageOptions, ShapeListing
from service.shapes.schemas import Filters
from service.web import endpoints as assets
from tests.service.support import Running, assert_problem

ROOT = Path(__file__).parents[3]
STATIC = ROOT / "service" / "web" / "static"
PAGES = ("index.html", "view.html", "docs.html")
OWN_SCRIPTS = sorted(name for name in assets.names() if name.endswith(".js") and "/" not in name)


def needed(name: str, *, later: bool) -> set[str]:
    """A file, and all that it loads at once, or later too, by their names."""
    text = (STATIC / name).read_text()
    if name.endswith(".html"):
        found = set(re.findall(r'(?:src|href)="(?:\.\./)*page/([^"]+)"', text))
    elif name in OWN_SCRIPTS:
        text = re.sub(r"/\*\*.*?\*/", "", text, flags=re.DOTALL)
        found = set(re.findall(r'(?:from|import) "\./([^"]+)"', text))
        if later:
            found |= set(re.findall(r'import\("\./([^"]+)"\)', text))
    else:
        found = set()
    return {name}.union(*(needed(each, later=later) for each in found))


@pytest.mark.parametrize("page", PAGES)
def test_every_file_that_a_page_loads_is_sent(page: str) -> None:
    loaded = needed(page, later=True)
    assert len(loaded) > 3
    assert loaded <= assets.names()


def test_the_first_load_is_small_and_without_the_3d_library() -> None:
    first = needed("index.html", later=False)
    assert "vendor/three.js" not in first
    assert "vendor/three.js" in needed("index.html", later=True)
    assert sum(len(assets.load(name).packed) for name in first) < 50_000


@pytest.mark.parametrize(
    ("form", "filters"),
    [
        ("find-form", {*Filters.model_fields, "exclude", "min_cc", "scale"}),
        ("gallery-form", {*Filters.model_fields, *ShapeListing.model_fields} - {*PageOptions.model_fields}),
        ("map-form", {*Filters.model_fields}),
        ("duplicates-form", {*Filters.model_fields}),
    ],
)
def test_every_filter_of_an_address_has_a_field_or_is_shown_without_one(form: str, filters: set[str]) -> None:
    found = re.search(
        rf'<form id="{form}" data-filters="([^"]*)"(.*?)</form>',
        (STATIC / "index.html").read_text(),
        re.DOTALL,
    )
    assert found is not None
    without, fields = found[1].split(), re.findall(r' name="(\w+)"', found[2])
    assert len({*without, *fields}) == len(without) + len(fields)
    assert filters <= {*without, *fields}
    titles = re.findall(r'^  (\w+): "[^"]+",$', (STATIC / "fields.js").read_text(), re.MULTILINE)
    assert set(without) <= set(titles)


@pytest.mark.parametrize("name", [*PAGES, *OWN_SCRIPTS, "style.css"])
def test_nothing_is_taken_from_elsewhere(name: str) -> None:
    assert re.findall(r"(?:https?:)?//[a-z0-9-]+\.[a-z]", (STATIC / name).read_text()) == []


@pytest.mark.parametrize("page", PAGES)
def test_no_script_or_style_is_written_into_a_page(page: str) -> None:
    text = (STATIC / page).read_text()
    scripts = re.findall(r"<script[^>]*>([^<]*)</script>", text)
    assert scripts
    assert not any(scripts)
    assert not re.search(r"<style|\sstyle=|\son[a-z]+=|javascript:", text)


def test_the_wheel_has_every_file_that_is_sent() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    data = project["tool"]["setuptools"]["package-data"]
    assert [(ROOT / "service" / name).is_file() for name in data["service"]] == [True]
    patterns = data["service.web"]
    for name in assets.names():
        depth = name.count("/") + 2
        assert any(fnmatch(f"static/{name}", p) for p in patterns if p.count("/") + 1 == depth), name


def test_vendored_files_are_licensed_and_named() -> None:
    told = (STATIC / "vendor" / "README.md").read_text()
    for name in assets.names():
        if name.startswith("vendor/") and not name.endswith(".txt"):
            size = (STATIC / name).stat().st_size
            assert re.search(rf"\| {re.escape(name[7:])} \| \S+ \d+\.\d+\.\d+ \| {size} \|", told), name
    assert {"vendor/three.LICENSE.txt", "vendor/swagger-ui.LICENSE.txt"} <= assets.names()


@pytest.mark.parametrize("address", ["/", "/docs"])
def test_a_page_may_run_the_services_own_scripts_alone(shared: Running, address: str) -> None:
    answer = shared.client.get(address)
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    rules = dict(rule.split(" ", 1) for rule in answer.headers["content-security-policy"].split("; "))
    assert rules["default-src"] == "'none'"
    assert rules["script-src"] == rules["style-src"] == rules["connect-src"] == "'self'"
    assert rules["frame-ancestors"] == rules["base-uri"] == "'none'"


@pytest.mark.parametrize("name", sorted(assets.names()))
def test_a_file_is_sent_packed_or_not_and_once(shared: Running, name: str) -> None:
    data = (STATIC / name).read_bytes()
    plain = shared.client.get(f"/page/{name}", headers={"accept-encoding": "identity"})
    assert plain.content == data
    assert plain.headers["x-content-type-options"] == "nosniff"
    assert "content-encoding" not in plain.headers
    packed = shared.client.get(f"/page/{name}", headers={"accept-encoding": "br, gzip;q=0.8"})
    assert packed.content == data
    assert int(packed.headers["content-length"]) <= len(data)
    if len(data) > 1000:
        assert packed.headers["content-encoding"] == "gzip"
    again = shared.client.get(f"/page/{name}", headers={"if-none-match": plain.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


@pytest.mark.parametrize(
    "name",
    [
        "nothing.js",
        "vendor/three.d.ts",
        "../endpoints.py",
        "%2e%2e/endpoints.py",
        "..%2fendpoints.py",
        "/etc/passwd",
        "vendor",
    ],
)
def test_no_other_file_is_sent(shared: Running, name: str) -> None:
    assert_problem(shared.client.get(f"/page/{name}"), 404, "not-found")
