"""Webhooks: messages that tell an address of the operator what is new in the archive."""

__all__ = ["sender"]
