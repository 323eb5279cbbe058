"""The slope of memory, of series whose slope is known, and of processes that take a known amount."""

import os
import subprocess
import sys

import numpy as np
import pytest

from tests.service.processes import children
from tests.soak.load.__main__ import grown
from tests.soak.load.memory import growth, resident


@pytest.mark.parametrize("slope", [0.0, 0.5, 3.0, -2.0])
def test_a_straight_line_has_its_slope_and_noise_does_not_change_it_much(slope: float) -> None:
    seconds = np.arange(0.0, 1200.0, 2.0)
    line = 500 + slope * seconds / 60
    assert growth(seconds, line).slope == pytest.approx(slope, abs=1e-9)
    noisy = growth(seconds, line + np.random.default_rng(0).normal(scale=5, size=len(seconds)))
    assert noisy.slope == pytest.approx(slope, abs=0.1)
    assert noisy.last - noisy.first == pytest.approx(slope * 18, abs=3)
    assert bool(grown("service", noisy)) == (slope > 1)


@pytest.mark.parametrize(("slope", "wrong"), [(4.0, False), (12.0, True)])
def test_a_short_run_is_judged_by_the_growth_in_all(slope: float, wrong: bool) -> None:
    seconds = np.arange(45.0, 180.0, 2.0)
    assert bool(grown("service", growth(seconds, 300 + slope * seconds / 60))) == wrong


HOLD = """
held = []
while amount := input():
    held.append(b"x" * (int(amount) << 20))
    print(amount, flush=True)
"""


def test_the_memory_and_the_parent_of_a_process() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None

        def hold(mib: int) -> float:
            print(mib, file=process.stdin, flush=True)
            assert process.stdout.readline() == f"{mib}\n"
            return resident(process.pid)

        first = hold(1)
        assert hold(100) - first == pytest.approx(100, abs=5)
        assert process.pid in children(os.getpid())
        print(file=process.stdin, flush=True)
        process.wait()
        assert process.pid not in children(os.getpid())
        assert resident(process.pid) == 0.0
