"""Fixtures that all tests share."""

import signal

from hypothesis import settings

# A busy machine is no fault of a test.
settings.register_profile("isoshape", deadline=None)
settings.load_profile("isoshape")

# A shell that runs the tests in the background has them, and all that they start, ignore Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
