"""Warms up the fork server, so that every worker process starts warm.

A fork server can only import modules: it imports this one, and nothing else does.
"""

from contextlib import suppress

from core.descriptors import network_views
from core.parameters import DEFAULT
from service.compute import sandbox
from service.compute.compilation import is_compiled
from service.compute.tasks import warm

__all__ = ["sandbox"]

# A worker process has the same error, and says so.
with suppress(Exception):
    # Compilation takes a minute, which is shown, and its memory would stay.
    if is_compiled(DEFAULT):
        warm(DEFAULT)
    # Workers load the library that runs it: readers have no room for it.
    if network_views.is_available():
        network_views.model()
