"""SIGTERM ends the commands that clean up, wherever it meets them."""

import asyncio
import signal
from contextlib import suppress

import pytest

from service.server.process import sigterm_exits

SECONDS = 60


class SignalledWhenDropped:
    """Gets the signal where Python drops the exceptions of handlers."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGTERM)


def test_a_signal_that_meets_the_event_loop_cancels_its_task():
    cleaned_up = False

    async def work() -> None:
        nonlocal cleaned_up
        try:
            SignalledWhenDropped()
            await asyncio.sleep(SECONDS)
            pytest.fail("the signal is lost")
        finally:
            await asyncio.sleep(0)
            cleaned_up = True

    with pytest.raises(SystemExit) as ended, sigterm_exits():
        asyncio.run(work())
    assert ended.value.code == 128 + signal.SIGTERM
    assert cleaned_up


@pytest.mark.parametrize("suppressed", [(), (KeyboardInterrupt,)])
def test_a_signal_that_meets_other_work_ends_it(suppressed):
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit) as ended, sigterm_exits(), suppress(*suppressed):
        signal.raise_signal(signal.SIGTERM)
    assert ended.value.code == 128 + signal.SIGTERM
    assert signal.getsignal(signal.SIGTERM) == before


def test_an_interrupt_stays_one():
    with pytest.raises(KeyboardInterrupt), sigterm_exits():
        signal.raise_signal(signal.SIGINT)
