"""The compilation of the kernels: once, by one process, and with progress."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from core.parameters import DEFAULT, PAPER
from service.compute import compilation
from service.compute.compilation import compile_kernels, is_compiled, warm_once_compiled
from service.compute.processes import WorkerProcess
from tests.service.support import wait_until
from tests.service.tasks import holds_the_network, times_warmed_up

CODE = """
from core.parameters import DEFAULT
from service.compute import compilation
compilation._compile_side_by_side = lambda parameters: None
compilation.warm = lambda parameters: print("compiles", flush=True) or time.sleep(1)
import time
before = compilation.is_compiled(DEFAULT)
print(before, compilation.compile_kernels(DEFAULT), compilation.is_compiled(DEFAULT))
"""


def started(folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", CODE],
        env=os.environ | {"NUMBA_CACHE_DIR": str(folder)},
        stdout=subprocess.PIPE,
        text=True,
    )


def test_of_several_processes_one_compiles_and_the_others_wait(tmp_path: Path) -> None:
    processes = [started(tmp_path) for _ in range(2)]
    said = [process.communicate(timeout=120)[0] for process in processes]
    assert sorted(text.count("compiles") for text in said) == [0, 1]
    assert sorted(text.split()[-2] for text in said) == ["False", "True"]
    assert all(text.split()[-1] == "True" for text in said)
    later = started(tmp_path).communicate(timeout=120)[0]
    assert later.split() == ["True", "False", "True"]


def test_the_second_process_ends_with_the_first(tmp_path: Path) -> None:
    code = (
        "from core.parameters import DEFAULT\nfrom service.compute import compilation\n"
        "compilation.warm_surfaces = lambda parameters: print('begun', flush=True)\n"
        "compilation._compile_side_by_side(DEFAULT)"
    )
    first = subprocess.Popen(
        [sys.executable, "-c", code],
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert first.stdout is not None
    assert first.stdout.readline() == "begun\n"
    (second,) = Path(f"/proc/{first.pid}/task/{first.pid}/children").read_text().split()

    def runs() -> bool:
        try:
            return Path("/proc", second, "cmdline").read_bytes() != b""
        except FileNotFoundError:
            return False

    assert runs()
    first.kill()
    first.communicate()
    wait_until(lambda: not runs(), seconds=30)


def test_a_failed_compilation_is_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compilation, "_stamp", lambda parameters: tmp_path / f"{parameters.name}.compiled")

    monkeypatch.setattr(compilation, "_compile_side_by_side", lambda parameters: None)

    def fails(parameters: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(compilation, "warm", fails)
    with pytest.raises(KeyboardInterrupt):
        compile_kernels(DEFAULT)
    assert not is_compiled(DEFAULT)
    monkeypatch.setattr(compilation, "warm", lambda parameters: None)
    assert compile_kernels(DEFAULT)
    assert is_compiled(DEFAULT)
    # Another pipeline has other kernels.
    assert not is_compiled(PAPER)


def test_a_worker_process_starts_warm_and_loads_the_network_by_itself() -> None:
    compile_kernels(DEFAULT)
    process = WorkerProcess()

    def result(task: Callable[..., Any], *arguments: object) -> Any:
        process.send(task, arguments)
        return process.receive(60.0)

    try:
        assert result(times_warmed_up) == 1
        holds, threads = result(holds_the_network)
        assert not holds
        result(warm_once_compiled, DEFAULT)
        assert result(holds_the_network) == (True, threads)
    finally:
        process.end()


def test_progress_counts_compiled_functions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    warm = compilation.warm
    monkeypatch.setattr(compilation, "_stamp", lambda parameters: tmp_path / "stamp")
    told: list[tuple[int, int]] = []

    def warms(parameters: object) -> None:
        warm(DEFAULT)
        before = len(told)
        wait_until(lambda: len(told) > before, seconds=30)

    monkeypatch.setattr(compilation, "warm", warms)
    assert compile_kernels(DEFAULT, lambda done, total: told.append((done, total)))
    done, total = told[-1]
    # Functions that others call are not counted where the cache has them.
    assert 20 < done <= total


def test_where_nothing_can_be_written_every_process_compiles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setattr(compilation, "_stamp", lambda parameters: tmp_path / "file" / "stamp")
    monkeypatch.setattr(compilation, "_compile_side_by_side", lambda parameters: None)
    monkeypatch.setattr(compilation, "warm", lambda parameters: None)
    assert compile_kernels(DEFAULT)
    assert compile_kernels(DEFAULT)


def test_kernels_that_python_calls_are_compiled_before_they_are_asked_for() -> None:
    # Compiled code is counted in a new process: other tests have called the kernels in this one.
    code = """
import importlib, pkgutil, sys
import core, service.search
from core.parameters import DEFAULT
from service.compute.compilation import _kernels
from service.compute.tasks import warm

for package in core, service.search:
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        importlib.import_module(module.name)
kernels = _kernels(list(sys.modules.values()))
called_by_kernels = {name for kernel in kernels for name in kernel.py_func.__code__.co_names}
asked = {kernel.py_func.__name__: kernel for kernel in kernels}
warm(DEFAULT)
print(*(name for name in asked.keys() - called_by_kernels if not asked[name].signatures))
print(len(asked.keys() - called_by_kernels))
"""
    missing, asked = subprocess.check_output([sys.executable, "-c", code], text=True).splitlines()
    assert missing == ""
    assert int(asked) > 40
