"""The comparison of a folder with what the archive knows of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from service.sources.repository import KnownFile
from service.sources.walk import FoundFile, Tree


@dataclass
class Differences:
    """The differences of a folder from an earlier scan.

    `back` has files that are unchanged, but were missing or had a path of another spelling; `changed` those
    that must be read again; `new` those of new paths, by their keys; and `vanished` those that are not found
    where folders could be listed.
    """

    back: list[tuple[KnownFile, FoundFile]] = field(default_factory=list)
    changed: list[tuple[KnownFile, FoundFile]] = field(default_factory=list)
    new: dict[str, FoundFile] = field(default_factory=dict)
    vanished: list[KnownFile] = field(default_factory=list)


def compare(known: Mapping[str, KnownFile], tree: Tree) -> Differences:
    """Compare a folder with its known files, by path, size, time of change and inode."""
    differences = Differences()
    for key, found in tree.files.items():
        file = known.get(key)
        if file is None:
            differences.new[key] = found
        elif file.same_bytes != found.same_bytes or file.state == "unreadable":
            differences.changed.append((file, found))
        elif file.state == "missing" or file.path != found.path:
            differences.back.append((file, found))
    differences.vanished = [
        file for key, file in known.items() if key not in tree.files and not tree.may_have(key)
    ]
    return differences


def same_files(
    known: Mapping[str, KnownFile], differences: Differences
) -> dict[str, tuple[FoundFile, KnownFile]]:
    """Return the new paths of files that are known by inode, size and time of change, by their keys."""
    unsettled = {file.number for file, _ in differences.changed}
    by_state = {
        file.same_bytes: file
        for file in known.values()
        if file.sha256 is not None and file.state in {"present", "missing"} and file.number not in unsettled
    }
    return {
        key: (found, by_state[found.same_bytes])
        for key, found in differences.new.items()
        if found.same_bytes in by_state
    }


def has_lost_half(known: Mapping[str, KnownFile], lost: list[KnownFile], tree: Tree) -> bool:
    """Return whether a source has lost more than half of its files, or all, by a fault of its disk perhaps.

    Files that a pattern leaves out are not lost.
    """
    before = sum(file.state != "missing" for file in known.values())
    return 2 * sum(not tree.is_ignored(file.path) for file in lost) > before
