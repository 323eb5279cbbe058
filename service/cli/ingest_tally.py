"""The tally of `isoshape ingest`: its progress in lines, and the summary at its end."""

import time
from dataclasses import dataclass, field

from service.cli.archive_upload import Done
from service.client import Upload
from service.client.concurrent_uploads import Item
from service.console import output, say

SECONDS_BETWEEN_LINES = 30.0
"""Seconds between two lines of progress, where standard error is no terminal that shows a bar."""


@dataclass
class Tally:
    """Numbers of files and archives by their outcomes.

    Attributes
    ----------
    total : int
        Files and archives to send.
    ignored : int
        Files of other formats.
    finished, created, present : int
        Files and archives that have an outcome, and shapes that were stored or there before.
    refused, warnings : list
        Files by their origin, each with the cause or the warning.
    """

    total: int
    ignored: int
    finished: int = 0
    created: int = 0
    present: int = 0
    refused: list[tuple[str, str]] = field(default_factory=list)
    warnings: list[tuple[str, str]] = field(default_factory=list)
    _said: float = field(default_factory=time.monotonic)

    @property
    def left(self) -> int:
        """The number of files and archives without an outcome."""
        return self.total - self.finished

    def add(self, item: Item, outcome: Upload | str) -> None:
        """Count the outcome of a file: the shapes of its upload, or the cause of its refusal."""
        self.finished += 1
        if isinstance(outcome, str):
            self.refused.append((item.origin, outcome))
        else:
            for one in (outcome, *outcome.parts):
                self._count(item, one)

    def _count(self, item: Item, one: Upload) -> None:
        """Count a shape of a file."""
        if one.created:
            self.created += 1
            self.warnings += [(item.origin, warning) for warning in one.shape.warnings]
        else:
            self.present += 1

    def add_archive(self, done: Done) -> None:
        """Count the outcomes of the files of an archive."""
        self.finished += 1
        self.created += done.stored
        self.present += done.present
        self.refused += done.refused

    def say_now_and_then(self, *, visible: bool) -> None:
        """Print a line of progress, if it is `visible` and the last one is some time ago."""
        if visible and time.monotonic() > self._said + SECONDS_BETWEEN_LINES:
            self._said = time.monotonic()
            say(f"{self.finished} of {self.total} done, {len(self.refused)} refused")

    def print(self) -> None:
        """Print the summary, then each warning and each refusal with its file."""
        left_out = f", {self.ignored} of other formats left out" if self.ignored else ""
        counts = f"{self.created} stored, {self.present} already there, {len(self.refused)} refused"
        output().print(f"{counts}{left_out}", soft_wrap=True)
        for origin, cause in sorted(self.warnings) + sorted(self.refused):
            say(f"{origin}: {cause}")
