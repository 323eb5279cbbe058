"""Subsets of large collections."""

from collections import defaultdict
from pathlib import Path


def spread(files: list[tuple[Path, str]], count: int) -> list[tuple[Path, str]]:
    """Choose `count` files from as many classes as can have two each, in the order of the collection.

    The classes are evenly spaced, by name, among those with two files or more. Files are taken in turn: the
    first of every class before the second of any. Other classes are used when these have no more files.
    """
    by_class: dict[str, list[tuple[Path, str]]] = defaultdict(list)
    for file in files:
        by_class[file[1]].append(file)
    large = sorted(name for name, members in by_class.items() if len(members) > 1)
    wanted = min(len(large), max(1, count // 2))
    chosen = [large[i * len(large) // wanted] for i in range(wanted)]
    others = sorted(set(by_class) - set(chosen))
    ordered = _in_turn([by_class[name] for name in chosen]) + _in_turn([by_class[name] for name in others])
    kept = set(ordered[:count])
    return [file for file in files if file in kept]


def _in_turn(lists: list[list[tuple[Path, str]]]) -> list[tuple[Path, str]]:
    depth = max(map(len, lists), default=0)
    return [members[i] for i in range(depth) for members in lists if i < len(members)]
