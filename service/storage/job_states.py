"""The states of a bulk job, as the database keeps them."""

from typing import Literal

State = Literal["arriving", "waiting", "running", "done", "failed", "cancelled"]
"""Of a job. One that is arriving is not acknowledged, and is shown to nobody."""

ACTIVE: tuple[State, ...] = ("waiting", "running")
ENDED: tuple[State, ...] = ("done", "failed", "cancelled")
