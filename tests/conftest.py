"""Fixtures that all tests share."""

import gc
import signal

from hypothesis import settings

# A busy machine is no fault of a test.
settings.register_profile("isoshape", deadline=None)
settings.load_profile("isoshape")

# What is collected stays to the end: the garbage collector need not look at it.
gc.disable()

# A shell that runs the tests in the background has them, and all that they start, ignore Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    """Collect the garbage of tests, and not the tests."""
    gc.freeze()
    gc.enable()
