"""The rules about who imports whom, read from the source."""

import ast
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
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
    "service.errors", "service.turns", "service.collection", "service.observability", "service.storage",
    "service.storage.migrations.versions", "service.storage.migrations", "service.auth", "service.settings",
    "service.http", "service.rendering", "service.web", "service.compute",
    "service.index", "service.pipelines", "service.container", "service.collections",
    "service.shapes", "service.previews", "service.search", "service.duplicates",
    "service.jobs", "service.sources", "service.webhooks", "service.system", "service.app",
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
    # And pickle too.
    ("core.descriptors.network_weights", "io"),
    # Ranges and types of parameters are declared, and JSON is checked against them.
    ("core.parameters", "pydantic"),
}

# Who alone imports a package.
ONLY = {
    "trimesh": ("core.io.trimesh_export", "service.evaluation.baselines"),
    "lapy": ("service.evaluation.baselines",),
    "sklearn": ("service.evaluation.baselines",),
    "service.evaluation": ("service.evaluation", "service.cli"),
    "service.app": ("service.app", "service.cli.serve", "service.cli.service_address"),
}

# Who never imports what, in folders where the order allows it.
NEVER = {
    "service.compute": ("service.storage",),
    "service.shapes.repository": ("service.shapes.service", "service.shapes.endpoints", "service.container"),
    "service.search.repository": ("service.search.answer", "service.search.endpoints", "service.container"),
    "service.jobs.repository": ("service.jobs.service", "service.jobs.endpoints", "service.container"),
    "service.shapes.service": ("service.shapes.endpoints", "fastapi", "sqlalchemy"),
    "service.search.answer": ("service.search.endpoints", "fastapi", "sqlalchemy"),
    "service.jobs.service": ("service.jobs.endpoints", "fastapi", "sqlalchemy"),
    "service.shapes.endpoints": ("service.shapes.repository", "service.storage", "sqlalchemy"),
    "service.search.endpoints": ("service.search.repository", "service.storage", "sqlalchemy"),
    "service.jobs.endpoints": ("service.jobs.repository", "service.storage", "sqlalchemy"),
}


@cache
def imports() -> dict[str, set[str]]:
    """The imports of each module, by full name: the module, where a name in a package is one."""
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


def importing(package: str) -> set[str]:
    """The modules that import something of a package."""
    return {module for module, names in imports().items() if any(within(name, package) for name in names)}


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


def test_no_module_imports_itself_by_a_detour() -> None:
    edges = {module: imported & set(imports()) - {module} for module, imported in imports().items()}
    TopologicalSorter(edges).prepare()


@pytest.mark.parametrize("package", ONLY)
def test_a_package_is_imported_by_few(package: str) -> None:
    users = importing(package)
    assert users
    assert [user for user in users if not any(within(user, only) for only in ONLY[package])] == []


@pytest.mark.parametrize("who", NEVER)
def test_layers_of_the_service_import_downwards(who: str) -> None:
    modules = {module for module in imports() if within(module, who)}
    assert modules
    assert [name for name in NEVER[who] if modules & importing(name)] == []


def test_sql_is_in_repositories_and_storage_only() -> None:
    others = [module for module in importing("sqlalchemy") if not module.endswith("repository")]
    # Settings and commands read addresses.
    homes = ("service.storage", "service.settings", "service.cli")
    assert [module for module in others if not any(within(module, home) for home in homes)] == []
