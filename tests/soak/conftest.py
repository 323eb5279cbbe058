"""Fixtures of the service's tests, for those that run longer."""

from tests.service.conftest import _stopped_at_the_end, engine, service, services, shared

__all__ = ["_stopped_at_the_end", "engine", "service", "services", "shared"]
