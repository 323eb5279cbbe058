"""The promises of the service, and whether an archive keeps them."""

import hashlib
import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Sent:
    """An upload: its name, which is that of no other, and what else the shape must hold."""

    name: str
    data: bytes
    tag: str
    metadata: Mapping[str, Any]

    def faults(self, shape: Mapping[str, Any]) -> Iterable[str]:
        """The other fields of a stored shape."""
        wanted = {
            "tags": [self.tag],
            "metadata": dict(self.metadata),
            "bytes": len(self.data),
            "sha256": hashlib.sha256(self.data).hexdigest(),
            "embedded": True,
        }
        for field, value in wanted.items():
            if shape[field] != value:
                yield f"{self.name} is torn: {field} is {shape[field]!r}, not {value!r}"


class Ledger:
    """Every upload and deletion that was sent, and how far each has come; for many threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._sent: dict[str, Sent] = {}
        self._stored: dict[str, str] = {}
        self._going: dict[str, str] = {}
        self._gone: set[str] = set()
        self.uploads = self.deletions = self.found = 0

    @property
    def acknowledged(self) -> int:
        """The number of uploads and deletions so far."""
        return self.uploads + self.deletions

    def send(self, upload: Sent) -> None:
        """The upload is about to be sent."""
        with self._lock:
            self._sent[upload.name] = upload

    def stored(self, name: str, shape_id: str) -> None:
        """The upload was acknowledged."""
        with self._lock:
            self._stored[shape_id] = name
            self.uploads += 1

    def deleted(self, shape_id: str) -> None:
        """The deletion was acknowledged."""
        with self._lock:
            name = self._going.pop(shape_id)
            del self._sent[name]
            self._gone.add(name)
            self.deletions += 1

    def take(self, more_than: int) -> str | None:
        """A shape whose deletion is about to be sent: the one stored longest, if there are so many."""
        with self._lock:
            if len(self._stored) <= more_than:
                return None
            shape_id = next(iter(self._stored))
            self._going[shape_id] = self._stored.pop(shape_id)
            return shape_id

    def data(self, name: str) -> bytes:
        """The bytes that were uploaded under a name."""
        return self._sent[name].data

    def settle(self, shapes: Iterable[Mapping[str, Any]]) -> list[str]:
        """Faults of the stored shapes while nothing is being sent; then the stored shapes are the truth.

        What was sent and not acknowledged may be there, whole, or not; and no name is there twice.
        """
        present = {shape["id"]: shape for shape in shapes}
        named = [shape["name"] for shape in present.values()]
        faults = [f"{name} is there {named.count(name)} times" for name in {*named} if named.count(name) > 1]
        faults += [f"{name}, acknowledged, is lost" for i, name in self._stored.items() if i not in present]
        for shape_id, shape in present.items():
            name = shape["name"]
            if name in self._gone:
                faults.append(f"{name} is there again after its deletion was acknowledged")
            elif name not in self._sent:
                faults.append(f"{name} is there and was never sent")
            else:
                faults += self._sent[name].faults(shape)
                if shape_id not in self._stored and shape_id not in self._going:
                    self.found += 1
        self._stored = {shape_id: shape["name"] for shape_id, shape in present.items()}
        self._going = {}
        self._sent = {name: self._sent[name] for name in named if name in self._sent}
        return sorted(faults)
