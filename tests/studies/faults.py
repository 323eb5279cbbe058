"""Put small faults into the project, one at a time, and count those that the tests of the folder catch.

    python -m tests.studies.faults DIR [--count 60] [--seed 0] [--only core]

The faults are drawn with a seed: flipped comparisons, swapped operators, limits off by one, conditions
turned round, statements left out. Each is written into a copy of the tree, where the tests of the module's
folder run until the first fails. A fault that no test notices may be equivalent to the original: read them.
"""

import ast
import csv
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from tests.studies.common import run

ROOT = Path(__file__).parents[2]
LONGEST_SECONDS = 1200

COMPARISONS = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "=="}
OPERATORS = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.BitAnd: "|"}
JUNCTIONS = {ast.And: " or ", ast.Or: " and "}


@dataclass(frozen=True)
class Fault:
    """A change of one place of a module: `old`, from offset `start` on, becomes `new`."""

    module: str
    line: int
    kind: str
    start: int
    old: str
    new: str


def faults_of(module: str, text: str) -> Iterator[Fault]:
    """Yield the faults that can be put into the text of a module."""
    starts = np.cumsum([0, *(len(line) for line in text.encode().splitlines(keepends=True))])

    def fault(node: ast.AST, kind: str, new: str) -> Fault:
        start = int(starts[node.lineno - 1]) + node.col_offset
        end = int(starts[node.end_lineno - 1]) + node.end_col_offset
        return Fault(module, node.lineno, kind, start, text.encode()[start:end].decode(), new)

    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Compare) and type(node.ops[0]) in COMPARISONS and len(node.ops) == 1:
            sides = ast.unparse(node.left), ast.unparse(node.comparators[0])
            yield fault(node, "comparison", f"({f' {COMPARISONS[type(node.ops[0])]} '.join(sides)})")
        elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS and not _is_text(node):
            sides = f"({ast.unparse(node.left)})", f"({ast.unparse(node.right)})"
            yield fault(node, "operator", f"({f' {OPERATORS[type(node.op)]} '.join(sides)})")
        elif isinstance(node, ast.BoolOp):
            sides = (f"({ast.unparse(value)})" for value in node.values)
            yield fault(node, "junction", f"({JUNCTIONS[type(node.op)].join(sides)})")
        elif isinstance(node, ast.Constant) and type(node.value) is int:
            yield fault(node, "off by one", f"({node.value} + 1)")
        elif isinstance(node, ast.If | ast.IfExp):
            yield fault(node.test, "condition", f"(not ({ast.unparse(node.test)}))")
        elif isinstance(node, ast.AugAssign) or (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Call | ast.Await)
        ):
            yield fault(node, "left out", "pass")


def _is_text(node: ast.BinOp) -> bool:
    """Return whether an operation joins texts or types, whose fault every import would show."""
    return any(
        isinstance(part, ast.JoinedStr)
        or (isinstance(part, ast.Constant) and not isinstance(part.value, int | float))
        for part in ast.walk(node)
    )


def draw(count: int, seed: int, only: str) -> list[Fault]:
    """Return so many faults, at most one a module: modules and then their faults are drawn evenly."""
    generator = np.random.default_rng(seed)
    paths = [path for package in ("core", "service") for path in sorted((ROOT / package).rglob("*.py"))]
    modules = [path.relative_to(ROOT).as_posix() for path in paths]
    modules = [module for module in modules if module.startswith(only)]
    drawn: list[Fault] = []
    for module in np.array(modules)[generator.permutation(len(modules))].tolist():
        possible = list(faults_of(module, (ROOT / module).read_text(encoding="utf-8")))
        if possible and len(drawn) < count:
            drawn.append(possible[generator.integers(len(possible))])
    return drawn


def tests_of(module: str) -> list[str]:
    """Return the tests of the folder of a module: the folder of tests that mirrors it, or its parent."""
    package, *folders = Path(module).parts[:-1]
    while folders and not (ROOT / "tests" / package / Path(*folders)).is_dir():
        folders.pop()
    if folders:
        return [Path("tests", package, *folders).as_posix()]
    return sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "tests" / package).glob("test_*.py"))


def is_caught(tree: Path, fault: Fault) -> bool:
    """Return whether a test of the module's folder fails, in a copy of the tree, with a fault."""
    path = tree / fault.module
    sound = path.read_bytes()
    end = fault.start + len(fault.old.encode())
    path.write_bytes(sound[: fault.start] + fault.new.encode() + sound[end:])
    if b"compil" in sound:
        # The cache of a compiled caller does not notice a change of what it calls.
        for cached in (tree / "core").rglob("*.nb[ic]"):
            cached.unlink()
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:schemathesis", "-p", "no:cacheprovider"]
    try:
        tests = [*command, "-m", "not studies", "-k", "not postgresql", *tests_of(fault.module)]
        environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(tree)}
        done = subprocess.run(
            tests, cwd=tree, env=environment, capture_output=True, timeout=LONGEST_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        return True
    finally:
        path.write_bytes(sound)
    return done.returncode != 0


def main(folder: Path, count: int, seed: int, only: str) -> None:
    """Put the faults in, write a row for each to faults.csv, and print how many were caught."""
    caught: Counter[str] = Counter()
    faults = draw(count, seed, only)
    with (
        tempfile.TemporaryDirectory(prefix="isoshape-faults-") as name,
        (folder / "faults.csv").open("w") as out,
    ):
        tree = Path(name)
        left_out = shutil.ignore_patterns(".git", ".venv", "build", "dist", "node_modules", ".*_cache")
        shutil.copytree(ROOT, tree, ignore=left_out, dirs_exist_ok=True)
        rows = csv.DictWriter(out, [*Fault.__dataclass_fields__, "caught", "seconds"])
        rows.writeheader()
        for fault in faults:
            began = time.monotonic()
            is_found = is_caught(tree, fault)
            caught[fault.kind] += is_found
            rows.writerow(asdict(fault) | {"caught": is_found, "seconds": round(time.monotonic() - began)})
            out.flush()
    kinds = Counter(fault.kind for fault in faults)
    print(f"{caught.total()} of {len(faults)} caught:", *(f"{k} {caught[k]}/{n}" for k, n in kinds.items()))


if __name__ == "__main__":
    run(main, __doc__, count=60, seed=0, only="")
