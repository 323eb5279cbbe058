"""Kill each change of an archive at each of its operations on the disk, and have each operation fail.

`python -m tests.soak.kill.sweep FOLDER POINTS [CHANGE…]`, with `faults.c` preloaded, prints a line of JSON a
change. The points are so many of all operations, evenly spread; 0 for all.
"""

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

from tests.soak.kill.changes import CHANGES, Change
from tests.soak.kill.power import Content, Disk, found, put
from tests.soak.kill.runs import Expected, Fault, Runs, Said

LEAST_POINTS = 3


@dataclass
class Row:
    """What became of a change: its operations, points and runs, faults and the longest time to be ready."""

    name: str
    operations: int
    points: int = 0
    kills: int = 0
    dropped: int = 0
    enospc: int = 0
    eio: int = 0
    ready_seconds: float = 0.0
    faults: list[str] = field(default_factory=list)

    def add(self, what: str, said: Said) -> None:
        """Add what a run said."""
        self.faults += [f"{self.name}, operation {what}: {fault}" for fault in said["faults"]]
        self.ready_seconds = max(self.ready_seconds, said.get("ready_seconds", 0.0))


class Sweep:
    """The runs of one change, and their row."""

    def __init__(self, runs: Runs, change: Change) -> None:
        self._runs, self._change = runs, change
        runs.renew(change)
        before = self._state()
        kinds = []
        for _ in range(2):
            said, _ = runs.make(change)
            assert said["acknowledged"], said
            kinds.append([(operation.kind, Path(operation.path).suffix) for operation in runs.log()])
        assert kinds[0] == kinds[1], f"two runs of {change.name} are not alike"
        self._expected = Expected(before, self._state())
        self._opened: set[tuple[int, bool]] = set()
        self.row = Row(change.name, len(kinds[0]))

    def _state(self) -> dict[str, object]:
        said = self._runs.reopen(self._change)
        assert said["faults"] == [], said["faults"]
        return dict(said["state"])

    def run(self, points: int) -> None:
        """Run the change with faults at so many of its operations, and with a loss of power at its end."""
        last = self.row.operations + 1
        for point in [*(1 + i * self.row.operations // points for i in range(points)), last]:
            self.row.points += 1
            self._kill(point)
            if point < last:
                self._fail(Fault("S", point), f"{point}, ENOSPC")
                self.row.enospc += 1
                # Of one operation, or of all from then on.
                self._fail(Fault("eE"[point % 2], point), f"{point}, EIO")
                self.row.eio += 1

    def _fail(self, fault: Fault, what: str) -> None:
        said, _ = self._runs.make(self._change, fault, self._expected)
        self.row.add(what, said)

    def _kill(self, point: int) -> None:
        said, disk = self._runs.make(self._change, Fault("k", point))
        what = f"{point}, killed"
        if said["killed"] != (point <= self.row.operations):
            said["faults"].append("the run is not like that without a fault")
        if disk.content() != found(self._runs.place):
            said["faults"].append("the log of the operations is not that of the folder")
        self.row.add(what, said)
        self.row.kills += 1
        acknowledged = said.get("acknowledged", False)
        self.row.add(what, self._runs.reopen(self._change, acknowledged, self._expected))
        for left, content in self._without_power(disk, point, acknowledged):
            self.row.dropped += 1
            put(content, self._runs.place)
            said = self._runs.reopen(self._change, acknowledged, self._expected)
            self.row.add(f"{what}, power lost, {left}", said)

    def _without_power(self, disk: Disk, point: int, acknowledged: bool) -> Iterator[tuple[str, Content]]:
        """Yield what a loss of power may leave: some of what is unsynced and, if that is new, none."""
        yield "some of what is unsynced dropped", disk.partly_synced(point)
        if (disk.syncs, acknowledged) not in self._opened:
            self._opened.add((disk.syncs, acknowledged))
            yield "all that is unsynced dropped", disk.synced()


def main() -> None:
    """Run everything."""
    runs, points = Runs(Path(sys.argv[1])), int(sys.argv[2])
    runs.prepare()
    sweeps = [Sweep(runs, change) for change in CHANGES if change.name in sys.argv[3:] or not sys.argv[3:]]
    total = sum(sweep.row.operations for sweep in sweeps)
    for sweep in sweeps:
        share = max(LEAST_POINTS, round((points or total) * sweep.row.operations / total))
        sweep.run(min(sweep.row.operations, share))
        print(json.dumps(asdict(sweep.row)), flush=True)


if __name__ == "__main__":
    main()
