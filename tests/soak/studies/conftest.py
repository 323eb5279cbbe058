"""Fixtures of the tests of the command line."""

from tests.service.cli.conftest import collection, environment, kept_pools, run, shared_processes

__all__ = ["collection", "environment", "kept_pools", "run", "shared_processes"]
