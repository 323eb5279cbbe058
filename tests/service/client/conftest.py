"""The fixtures of the command line's tests: an empty working folder, and a running service."""

from tests.service.cli.conftest import archive, database, environment, run, shared_service

__all__ = ["archive", "database", "environment", "run", "shared_service"]
