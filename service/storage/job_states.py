"""The states of a bulk job; clients import them without the database."""

from typing import Literal

State = Literal["arriving", "waiting", "running", "done", "failed", "cancelled"]
"""The state of a job. A job in the state "arriving" is not acknowledged yet, and is hidden."""

ACTIVE: tuple[State, ...] = ("waiting", "running")
ENDED: tuple[State, ...] = ("done", "failed", "cancelled")
