"""The rules about who imports whom, read from the source."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# Every folder of the tree, and every module outside a folder, each after all that it imports from.
ORDER = (
    "core.errors", "core.arrays", "core.parameters", "core.embedding", "core.numerics", "core.mesh",
    "core.io",
    "core.graph", "core.sampling", "core.spectral", "core.descriptors", "core.registration",
    "core.matching.kernels", "core.matching", "core.dense", "core.ranking", "core.serialization",
    "core.sparse_embedding", "core.pipeline",
    "core.gallery", "core.evaluation", "core",
    "service.errors", "service.collection", "service.observability", "service.storage",
    "service.storage.migrations.versions", "service.storage.migrations", "service.auth", "service.settings",
    "service.http.idempotency", "service.http", "service.rendering", "service.web", "service.compute",
    "service.index", "service.pipelines", "service.container", "service.dependencies", "service.collections",
    "service.shapes", "service.previews", "service.search", "service.duplicates",
    "service.jobs", "service.system", "service.app", "service.openapi_document",
    "service.client", "service.server", "service.console", "service.datasets", "service.report",
    "service.evaluation", "service.cli", "service.cli.evaluation",
    "service",
)  # fmt: skip

# The world outside: the core has none of it.
OUTSIDE = {
    "os", "sys", "io", "pathlib", "tempfile", "shutil", "glob", "time", "datetime", "random", "socket",
    "subprocess", "threading", "multiprocessing", "concurrent", "asyncio", "logging", "sqlite3", "sqlalchemy",
    "alembic", "fastapi", "starlette", "uvicorn", "httpx", "pydantic", "pydantic_settings", "typer", "rich",
}  # fmt: skip
ALLOWED_OUTSIDE = {
    # Bytes in memory, which trimesh wants to be a file.
    ("core.io", "io"),
    # Ranges and types of parameters are declared, and JSON is checked against them.
    ("core.parameters", "pydantic"),
}

WEB = {"fastapi", "starlette", "uvicorn"}


@cache
def imports() -> dict[str, set[str]]:
    """What each module of the project imports, by full name: the module, where a name in a package is one."""
    trees = {}
    for package in ("core", "service"):
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            trees[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = ast.parse(path.read_text())
    return {
        module: {full if full in trees else source for source, full in _imported(tree, module)}
        for module, tree in trees.items()
    }


def _imported(tree: ast.AST, module: str) -> Iterator[tuple[str, str]]:
    """Each import as the module it names, and as the full name of what it takes from there."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} imports relatively"
            assert node.module is not None
            yield from ((node.module, f"{node.module}.{alias.name}") for alias in node.names)


@cache
def packages() -> set[str]:
    """The folders of the project, by their names as packages."""
    return {
        ".".join(path.relative_to(ROOT).parent.parts)
        for package in ("core", "service")
        for path in (ROOT / package).rglob("__init__.py")
    }


@cache
def exported(package: str) -> list[str]:
    """The modules of a folder that its `__all__` gives to other folders."""
    tree = ast.parse((ROOT / package.replace(".", "/") / "__init__.py").read_text())
    lists = [
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    ]
    return [name for value in lists for name in ast.literal_eval(value)]


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".")


def test_there_is_something_to_check() -> None:
    assert {"core.pipeline", "core.mesh.mesh", "service.app", "service.shapes.repository"} <= set(imports())


def test_the_core_never_imports_the_service() -> None:
    for module, imported in imports().items():
        if within(module, "core"):
            assert not [name for name in imported if within(name, "service")], module


def test_the_core_is_pure() -> None:
    for module, imported in imports().items():
        for name in imported if within(module, "core") else ():
            top = name.partition(".")[0]
            allowed = any(within(module, where) and top == what for where, what in ALLOWED_OUTSIDE)
            assert allowed or top not in OUTSIDE, f"{module} imports {name}"


def test_the_core_opens_nothing() -> None:
    for path in (ROOT / "core").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id not in {"open", "input", "print", "exec", "eval"}, path


def place(module: str) -> str:
    """The folder of a module, or the module itself where it is in none."""
    folder = module if module in packages() else module.rpartition(".")[0]
    return module if folder in {"core", "service"} else folder


def test_folders_import_from_earlier_ones_only() -> None:
    rank = {name: number for number, name in enumerate(ORDER)}
    assert {place(module) for module in imports()} == set(rank), "ORDER has every folder once"
    wrong = [
        f"{module} imports {name}"
        for module, imported in imports().items()
        for name in imported
        if name in imports() and rank[place(name)] > rank[place(module)]
    ]
    assert not wrong


def test_folders_import_what_others_export() -> None:
    for module, imported in imports().items():
        for name in imported & set(imports()):
            if place(name) not in {place(module), name}:
                assert name.rpartition(".")[2] in exported(place(name)), f"{module} imports {name}"


@pytest.mark.parametrize("package", ["core", "service"])
def test_no_module_imports_itself_by_a_detour(package: str) -> None:
    modules = {name for name in imports() if within(name, package)}
    edges = {name: (imports()[name] & modules) - {name} for name in modules}
    done: set[str] = set()

    def visit(name: str, path: tuple[str, ...]) -> None:
        assert name not in path, " -> ".join([*path, name])
        if name not in done:
            for target in edges[name]:
                visit(target, (*path, name))
            done.add(name)

    for name in modules:
        visit(name, ())


def test_only_reading_imports_trimesh() -> None:
    users = {m for m, imported in imports().items() if any(within(name, "trimesh") for name in imported)}
    assert users
    # And the comparison with trimesh's own method.
    assert all(within(module, "core.io") or module == "service.evaluation.baselines" for module in users)


def test_libraries_of_comparisons_are_imported_by_comparisons_alone() -> None:
    for package in ("lapy", "sklearn"):
        users = {m for m, imported in imports().items() if any(within(name, package) for name in imported)}
        assert users == {"service.evaluation.baselines"}


def test_evaluation_is_for_the_command_line_alone() -> None:
    for module, imported in imports().items():
        if any(within(name, "service.evaluation") for name in imported):
            assert within(module, "service.evaluation") or within(module, "service.cli"), module


@pytest.mark.parametrize(
    ("who", "never"),
    [
        ("service.storage", ("service.shapes", "service.search", "service.compute", "service.app")),
        ("service.compute", ("service.shapes", "service.search", "service.storage", "service.app")),
        (
            "service.shapes.repository",
            ("service.shapes.service", "service.shapes.endpoints", "service.container"),
        ),
        (
            "service.search.repository",
            ("service.search.answer", "service.search.endpoints", "service.container"),
        ),
        ("service.jobs.repository", ("service.jobs.service", "service.jobs.endpoints", "service.container")),
        ("service.jobs.service", ("service.jobs.endpoints", "fastapi", "sqlalchemy")),
        ("service.jobs.endpoints", ("service.jobs.repository", "service.storage", "sqlalchemy")),
        ("service.shapes.service", ("service.shapes.endpoints", "fastapi", "sqlalchemy")),
        ("service.search.answer", ("service.search.endpoints", "fastapi", "sqlalchemy")),
        ("service.shapes.endpoints", ("service.shapes.repository", "service.storage", "sqlalchemy")),
        ("service.search.endpoints", ("service.search.repository", "service.storage", "sqlalchemy")),
    ],
)
def test_layers_of_the_service_import_downwards(who: str, never: tuple[str, ...]) -> None:
    modules = [module for module in imports() if within(module, who)]
    assert modules
    for module in modules:
        wrong = [i for i in imports()[module] if any(within(i, name) for name in never)]
        assert not wrong, f"{module} imports {wrong}"


def test_sql_is_in_repositories_and_storage_only() -> None:
    for module, imported in imports().items():
        if any(within(name, "sqlalchemy") for name in imported):
            at_home = within(module, "service.storage") or module.endswith("repository")
            reads_addresses = module == "service.settings" or within(module, "service.cli")
            assert at_home or reads_addresses, module


def test_only_the_app_and_the_command_line_know_the_app() -> None:
    for module, imported in imports().items():
        if any(within(name, "service.app") for name in imported):
            assert module in {
                "service.app",
                "service.openapi_document",
                "service.cli.serve",
                "service.cli.service_address",
            }, module
