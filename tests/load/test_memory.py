"""The slope of memory, of series whose slope is known, and of processes that take a known amount."""

import multiprocessing
import os
from multiprocessing.connection import Connection

import numpy as np
import pytest

from tests.load.__main__ import grown
from tests.load.memory import MIB, children, growth, resident
from tests.service.support import wait_until


@pytest.mark.parametrize("slope", [0.0, 0.5, 3.0, -2.0])
def test_a_straight_line_has_its_slope_and_noise_does_not_change_it_much(slope: float) -> None:
    seconds = np.arange(0.0, 1200.0, 2.0)
    line = 500 + slope * seconds / 60
    assert growth(seconds, line).slope == pytest.approx(slope, abs=1e-9)
    noisy = growth(seconds, line + np.random.default_rng(0).normal(scale=5, size=len(seconds)))
    assert noisy.slope == pytest.approx(slope, abs=0.1)
    assert noisy.last - noisy.first == pytest.approx(slope * 18, abs=3)
    assert bool(grown("service", noisy)) == (slope > 1)


def test_what_a_process_holds_and_whose_child_it_is() -> None:
    ours, theirs = multiprocessing.get_context("spawn").Pipe()
    process = multiprocessing.get_context("spawn").Process(target=_hold, args=(theirs,))
    process.start()
    assert process.pid is not None
    small = ours.recv()
    assert process.pid in children(os.getpid())
    ours.send(100)
    large = ours.recv()
    assert 95 < large - small < 110
    assert resident(process.pid) == pytest.approx(large, abs=5)
    ours.send(None)
    process.join()
    wait_until(lambda: process.pid not in children(os.getpid()), seconds=5)
    assert resident(process.pid) == 0.0


def _hold(connection: "Connection[object, object]") -> None:
    held = []
    connection.send(resident(os.getpid()))
    while (amount := connection.recv()) is not None:
        held.append(b"x" * (int(str(amount)) * MIB))
        connection.send(resident(os.getpid()))
